"""The folder of one run: what may be written where, and the files an episode leaves there.

Every file is written beside its place and moved there when it is whole; `summary.json` comes last,
so a folder that has one holds a complete run.
"""

import hashlib
import json
import os
import platform
import shutil
from collections.abc import Callable
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydrake.common.yaml import yaml_dump_typed

from diagrams.crossmodal.objects.own_object import content_hash, keep_object
from diagrams.crossmodal.scenario import Scenario
from diagrams.run.record import EpisodeResult
from diagrams.run.yaml_schema import ScenarioError, one_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO_FILE = "scenario.yaml"
ESTIMATES_FILE = "estimates.parquet"
SUMMARY_FILE = "summary.json"
MESHCAT_FILE = "meshcat.html"
MODEL_FOLDER = "model"  # The copy of an imported object.
SENSORS_FILE = "sensors.mcap"
FIGURE_FILES = ("figures/errors.png", "figures/opening.png", "figures/frames.png")
OWN_FILES = (
    SCENARIO_FILE,
    ESTIMATES_FILE,
    SUMMARY_FILE,
    MESHCAT_FILE,
    SENSORS_FILE,
    *FIGURE_FILES,
)

_PACKAGES = ("maths", "models", "plants", "systems", "controllers", "diagrams")
_SOURCE_TYPES = {".py", ".sdf", ".urdf", ".yaml", ".obj", ".mtl", ".png", ".npz", ".pt"}
# Modules and folders that only show results: a change there leaves finished episodes valid.
_PRESENTATION = {
    "command_line.py",
    "commands",
    "drawing",
    "evaluation",
    "experiments.py",
    "joint_drawing.py",
    "meshcat_view.py",
    "process.py",
    "results",
}


def default_folder(scenario: Scenario) -> Path:
    """Where a run is written unless the user says otherwise."""
    return Path("runs") / f"{scenario.name}-seed{scenario.seed}"


def open_run_folder(folder: Path, force: bool = False) -> Path:
    """Makes sure that a run can be written into the folder, before anything is computed.

    A folder that already holds something is refused, unless `force` allows to replace the files of
    an earlier run in it; other files stay in any case.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        occupied = any(folder.iterdir())
        if occupied and not force:
            raise ScenarioError(
                f"{folder}: already holds files; choose another folder with --out,"
                " or replace an earlier run there with --force"
            )
        probe = folder / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return folder


def write_atomically(path: Path, write: Callable[[Path], Any]) -> Path:
    """Lets `write` fill a file beside `path`, then moves it there."""
    partial = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(partial)
        os.replace(partial, path)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be written: {one_line(error)}") from None
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_text(path: Path, text: str) -> Path:
    return write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))


def write_scenario(folder: Path, scenario: Scenario) -> Path:
    """Writes the resolved scenario with the versions that run it; it can be run again as it is."""
    scenario.versions = versions()
    model = Path(scenario.object.model)
    if not model.is_absolute():
        shutil.rmtree(folder / MODEL_FOLDER, ignore_errors=True)
        return write_text(folder / SCENARIO_FILE, yaml_dump_typed(scenario))
    try:
        kept = keep_object(model, folder / MODEL_FOLDER)
        scenario.object.model = str(kept.relative_to(folder))
        return write_text(folder / SCENARIO_FILE, yaml_dump_typed(scenario))
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {one_line(error)}") from None
    finally:
        scenario.object.model = str(model)


def write_run(folder: Path, result: EpisodeResult) -> list[Path]:
    """Writes all files of an episode and returns them."""
    from diagrams.crossmodal.results.frame_plots import draw_frames
    from diagrams.crossmodal.results.plots import draw_errors, draw_openings, save
    from diagrams.joints.joint_record import estimates_table, summarise

    written = [write_scenario(folder, result.scenario)]
    table = estimates_table(result)
    written.append(
        write_atomically(folder / ESTIMATES_FILE, lambda path: table.to_parquet(path, index=False))
    )
    drawings: tuple[Callable[[EpisodeResult], Figure | None], ...] = (
        draw_errors,
        draw_openings,
        draw_frames,
    )
    for name, draw in zip(FIGURE_FILES, drawings, strict=True):
        figure = draw(result)
        if figure is not None:
            written.append(write_atomically(folder / name, partial(save, figure)))
    if result.meshcat_html is not None:
        written.append(write_text(folder / MESHCAT_FILE, result.meshcat_html))
    if result.sensors_file is not None:
        written.append(result.sensors_file)
    summary = summarise(result) | fingerprint(result.scenario)
    written.append(
        write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    )
    for name in OWN_FILES:
        if folder / name not in written:
            (folder / name).unlink(missing_ok=True)  # Left by the run that this one replaces.
    return written


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


@cache
def source_hash() -> str:
    """Hash of every file that can change an episode, as they were when it was first asked for."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*")):
            place = path.relative_to(root)
            if path.suffix in _SOURCE_TYPES and _PRESENTATION.isdisjoint(place.parts):
                digest.update(str(place).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def scenario_hash(scenario: Scenario) -> str:
    """Hash of all that the scenario says, its versions left out.

    Of an imported object it matters what it is, not where its copy lies.
    """
    versions, model = scenario.versions, scenario.object.model
    scenario.versions = {}
    if Path(model).is_absolute():
        scenario.object.model = content_hash(Path(model).parent)
    try:
        return hashlib.sha256(yaml_dump_typed(scenario).encode()).hexdigest()[:16]
    finally:
        scenario.versions, scenario.object.model = versions, model


def fingerprint(scenario: Scenario) -> dict[str, str]:
    """What decides whether a finished run is still the one that a scenario would give."""
    return {"scenario_hash": scenario_hash(scenario), "source_hash": source_hash()}


def finished_summary(folder: Path, scenario: Scenario) -> dict[str, Any] | None:
    """The summary of a complete run of this very scenario, seed and program, if there is one."""
    try:
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(summary, dict) or summary.get("interrupted"):
        return None
    current = fingerprint(scenario)
    return summary if all(summary.get(key) == value for key, value in current.items()) else None
