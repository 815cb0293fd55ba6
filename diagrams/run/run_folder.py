"""The folder of one run: what may be written where, and the files an episode leaves there.

Every file is written beside its place and moved there when it is whole; `summary.json` comes last,
so a folder that has one holds a complete run.
"""

import hashlib
import inspect
import json
import math
import os
import platform
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from diagrams.run.application import Application, Results
from diagrams.run.record import EpisodeRecord
from diagrams.run.scenario import Scenario
from diagrams.run.yaml_schema import ScenarioError, one_line

SCENARIO_FILE = "scenario.yaml"
ESTIMATES_FILE = "estimates.parquet"
SUMMARY_FILE = "summary.json"
MESHCAT_FILE = "meshcat.html"
SENSORS_FILE = "sensors.mcap"
PLOT_FOLDER = "figures"

_PACKAGES = ("maths", "models", "plants", "systems", "controllers", "diagrams")
_SOURCE_TYPES = {".py", ".sdf", ".urdf", ".yaml", ".obj", ".mtl", ".png", ".npz", ".pt"}
# Modules and folders that only show results: a change there leaves finished episodes valid.
_PRESENTATION = {
    "command_line.py",
    "commands",
    "drawing",
    "campaign.py",
    "campaign_plots.py",
    "campaign_report.py",
    "checksums.py",
    "comparison.py",
    "metric_table.py",
    "seeds.py",
    "experiments.py",
    "frame_plots.py",
    "joint_drawing.py",
    "joint_errors.py",
    "joint_palette.py",
    "meshcat_view.py",
    "metrics.py",
    "plots.py",
    "process.py",
    "report.py",
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


def write_scenario(folder: Path, application: Application, scenario: Scenario) -> Path:
    """Writes the resolved scenario with the versions that run it; it can be run again as it is."""
    scenario = replace(scenario, versions=versions())
    try:
        kept = application.keep_files(scenario, folder)
        return write_text(folder / SCENARIO_FILE, yaml_dump_typed(kept))
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {one_line(error)}") from None


def write_run(
    folder: Path, application: Application, record: EpisodeRecord, results: Results
) -> list[Path]:
    """Writes all files of an episode and returns them."""
    from diagrams.drawing.plot_style import save

    written = [write_scenario(folder, application, record.scenario)]
    written.append(
        write_atomically(
            folder / ESTIMATES_FILE, lambda path: results.estimates.to_parquet(path, index=False)
        )
    )
    for name, draw in results.plots.items():
        figure = draw()
        if figure is not None:
            written.append(write_atomically(folder / PLOT_FOLDER / name, partial(save, figure)))
    if record.meshcat_html is not None:
        written.append(write_text(folder / MESHCAT_FILE, record.meshcat_html))
    if record.sensors_file is not None:
        written.append(record.sensors_file)
    left = [path for path in _own_files(folder, results) if path not in written]
    for path in left:  # By the run that this one replaces.
        path.unlink(missing_ok=True)
    summary = summarise(application, record, results)
    written.append(
        write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    )
    return written


def _own_files(folder: Path, results: Results) -> list[Path]:
    names = [ESTIMATES_FILE, MESHCAT_FILE, SENSORS_FILE]
    return [
        folder / name for name in (*names, *(f"{PLOT_FOLDER}/{plot}" for plot in results.plots))
    ]


def summarise(application: Application, record: EpisodeRecord, results: Results) -> dict[str, Any]:
    """The summary of an episode, all in SI and rad, ready for JSON: what is unknown is None."""
    parts = dict(results.summary)
    modalities = {
        name: {**parts.get("modalities", {}).get(name, {}), "tick": _tick(estimator.tick_times)}
        for name, estimator in record.estimators.items()
    }
    parts.pop("modalities", None)
    events = sorted([*record.events, *results.events], key=lambda event: event.time)
    summary = {
        "scenario": record.scenario.name,
        "seed": record.scenario.seed,
        "success": results.failure is None and not record.interrupted,
        "duration": record.duration,
        "wall_time": record.wall_time,
        "real_time_factor": record.duration / record.wall_time if record.wall_time > 0 else None,
        "peak_memory": record.peak_memory,
        "interrupted": record.interrupted,
        "failure": "interrupted" if record.interrupted else results.failure,
        "modalities": modalities,
        **parts,
        "events": [{"time": event.time, "name": event.name} for event in events],
        **fingerprint(application, record.scenario),
    }
    return without_nan(summary)


def _tick(times: list[float]) -> dict[str, float | None]:
    return {
        "median": float(np.median(times)) if times else None,
        "p95": float(np.percentile(times, 95)) if times else None,
    }


def without_nan(value: Any) -> Any:
    """The same nested value with None for what JSON cannot hold: NaN and infinities."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


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


def scenario_hash(application: Application, scenario: Scenario) -> str:
    """Hash of all that the scenario says, its versions left out.

    Of a file that it names it matters what is in it, not where it lies.
    """
    said = application.identity(replace(scenario, versions={}))
    return hashlib.sha256(yaml_dump_typed(said).encode()).hexdigest()[:16]


def _own_hash(application: Application) -> str:
    """Hash of the file of an application that does not come with the program; else nothing."""
    file = inspect.getsourcefile(application.scenario)
    if file is None or Path(file).is_relative_to(Path(__file__).parents[1]):
        return ""
    return "-" + hashlib.sha256(Path(file).read_bytes()).hexdigest()[:8]


def fingerprint(application: Application, scenario: Scenario) -> dict[str, str]:
    """What decides whether a finished run is still the one that a scenario would give."""
    return {
        "scenario_hash": scenario_hash(application, scenario),
        "source_hash": source_hash() + _own_hash(application),
    }


def finished_summary(
    folder: Path, application: Application, scenario: Scenario
) -> dict[str, Any] | None:
    """The summary of a complete run of this very scenario, seed and program, if there is one."""
    try:
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(summary, dict) or summary.get("interrupted"):
        return None
    current = fingerprint(application, scenario)
    return summary if all(summary.get(key) == value for key, value in current.items()) else None
