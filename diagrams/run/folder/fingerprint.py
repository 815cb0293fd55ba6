"""What decides whether a finished run is still the one that a scenario would give."""

import hashlib
import inspect
import platform
from dataclasses import replace
from functools import cache
from importlib import metadata
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.scenario import Scenario

_PACKAGES = ("maths", "models", "plants", "systems", "controllers", "diagrams")
_SOURCE_TYPES = {".py", ".sdf", ".urdf", ".yaml", ".obj", ".mtl", ".png", ".npz", ".pt"}
# What only shows results: a change there leaves finished episodes valid.
PRESENTATION = (
    "diagrams/command_line.py",
    "diagrams/commands",
    "diagrams/crossmodal/inspection",
    "diagrams/crossmodal/meshcat_view.py",
    "diagrams/crossmodal/results/frame_plots.py",
    "diagrams/crossmodal/results/mechanics_plot.py",
    "diagrams/crossmodal/results/metrics.py",
    "diagrams/crossmodal/results/plots.py",
    "diagrams/crossmodal/results/report.py",
    "diagrams/crossmodal/studies/experiments.py",
    "diagrams/drawing",
    "diagrams/evaluation/campaign.py",
    "diagrams/evaluation/campaign_plots.py",
    "diagrams/evaluation/campaign_report.py",
    "diagrams/evaluation/comparison.py",
    "diagrams/evaluation/folder_checksums.py",
    "diagrams/evaluation/metric_table.py",
    "diagrams/evaluation/seeds.py",
    "diagrams/flap/experiments.py",
    "diagrams/flap/meshcat_view.py",
    "diagrams/flap/results/frame_plots.py",
    "diagrams/flap/results/line_plots.py",
    "diagrams/flap/results/metrics.py",
    "diagrams/flap/results/plots.py",
    "diagrams/joints/joint_drawing.py",
    "diagrams/joints/joint_errors.py",
    "diagrams/joints/joint_palette.py",
    "diagrams/run/process.py",
)


def versions() -> dict[str, str]:
    """Of the program, its sources and what it computes with."""
    names = ("crossmodal", "drake", "numpy", "scipy", "opencv-python-headless", "numba", "torch")
    found = {"python": platform.python_version(), "source": source_hash()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def only_shows(place: str) -> bool:
    """Whether a file, by its path from the root, cannot change the numbers of an episode."""
    return any(place == entry or place.startswith(f"{entry}/") for entry in PRESENTATION)


@cache
def source_hash() -> str:
    """Hash of every file that can change an episode, as they were when it was first asked for."""
    root = Path(__file__).parents[3]  # The package `crossmodal`.
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*")):
            place = path.relative_to(root).as_posix()
            if path.suffix in _SOURCE_TYPES and not only_shows(place):
                digest.update(place.encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def scenario_hash(application: Application, scenario: Scenario) -> str:
    """Hash of all that the scenario says, its versions left out.

    Of a file that it names it matters what is in it, not where it lies.
    """
    said = application.identity(replace(scenario, versions={}))
    return hashlib.sha256(yaml_dump_typed(said).encode()).hexdigest()[:16]


def _own_hash(application: Application) -> str:
    """Hash of the file of an application that does not come with the program; else nothing."""
    file = inspect.getsourcefile(application.scenario)
    if file is None or Path(file).is_relative_to(Path(__file__).parents[2]):
        return ""
    return "-" + hashlib.sha256(Path(file).read_bytes()).hexdigest()[:8]


def fingerprint(application: Application, scenario: Scenario) -> dict[str, str]:
    """What decides whether a finished run is still the one that a scenario would give."""
    return {
        "scenario_hash": scenario_hash(application, scenario),
        "source_hash": source_hash() + _own_hash(application),
    }
