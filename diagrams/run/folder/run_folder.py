"""The folder of one run: what may be written where, and the files an episode leaves there.

Every file is written beside its place and moved there when it is whole. A folder with a
`summary.json` holds a run's scenario and estimates; the run is complete if all files that the
summary names are there as they were written. Only these files are removed when another run
replaces it.
"""

import contextlib
import hashlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.fingerprint import fingerprint, versions
from crossmodal.diagrams.run.folder.kept_files import kept_files
from crossmodal.diagrams.run.folder.perceived_file import PERCEIVED_FILE
from crossmodal.diagrams.run.folder.written_files import is_within, write_text, write_within
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

SCENARIO_FILE = "scenario.yaml"
ESTIMATES_FILE = "estimates.parquet"
SUMMARY_FILE = "summary.json"
MESHCAT_FILE = "meshcat.html"
SENSORS_FILE = "sensors.mcap"
VIDEO_FILE = "episode.mp4"
PAGE_FILE = "report.html"
LOG_FILE = "log.txt"
PLOT_FOLDER = "figures"
# What a run may write whatever its application is.
FILES = (
    *(SCENARIO_FILE, ESTIMATES_FILE, SUMMARY_FILE, PERCEIVED_FILE),
    *(MESHCAT_FILE, SENSORS_FILE, VIDEO_FILE, PAGE_FILE, LOG_FILE),
)


def default_folder(scenario: Scenario) -> Path:
    """Where a run is written unless the user says otherwise."""
    return Path("runs") / f"{scenario.name}-seed{scenario.seed}"


def make_folder(folder: Path) -> Path:
    """Makes a folder before anything is computed for it.

    Raises:
        ScenarioError: where nothing can be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return folder


@contextlib.contextmanager
def opened(folder: Path, *, force: bool = False, numbered: bool = False) -> Iterator[Path]:
    """Makes the folder of a run before anything is computed; one left empty is removed again.

    Args:
        folder: Where to write.
        force: Whether an earlier run there may be replaced.
        numbered: Whether to take the first of `folder-2`, `folder-3`, ... that is not there yet
            where `folder` is.

    Raises:
        ScenarioError: where it cannot be written, or holds what must not be replaced.
    """
    places = chain([folder], (folder.with_name(f"{folder.name}-{n}") for n in count(2)))
    place = next(place for place in places if not (numbered and os.path.lexists(place)))
    made = [path for path in (place, *place.parents) if not os.path.exists(path)]
    make_folder(place)
    occupied = any(place.iterdir())
    if occupied and not force:
        raise ScenarioError(
            f"{place}: already holds files; choose another folder with --out,"
            " or replace an earlier run there with --force"
        )
    if occupied and not files_of_run(place):
        raise ScenarioError(
            f"{place}: holds files, but no run that --force could replace; choose another folder"
            " with --out"
        )
    try:
        yield place
    finally:
        with contextlib.suppress(OSError):
            for path in made:
                path.rmdir()


def read_summary(folder: Path) -> dict[str, Any]:
    """What `summary.json` in a folder holds; nothing where there is none, or another one."""
    try:
        if not is_within(folder, SUMMARY_FILE) or not (folder / SUMMARY_FILE).is_file():
            return {}
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return summary if isinstance(summary, dict) else {}


def files_of_run(folder: Path) -> list[str]:
    """The files of the run in a folder, the summary first, by their paths relative to it."""
    names = read_summary(folder).get("files")
    below = [name for name in names if is_within(folder, name)] if isinstance(names, list) else []
    return [SUMMARY_FILE, *below] if below else []


def remove_run(folder: Path, *, kept: Collection[str] = ()) -> None:
    """Removes the files of the run in a folder, and folders that are empty then."""
    for name in files_of_run(folder):
        if name not in kept and not (folder / name).is_dir():
            (folder / name).unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                for parent in PurePosixPath(name).parents[:-1]:
                    (folder / parent).rmdir()


def undrawn(place: Path, error: Exception) -> str:
    """A line about a picture that could not be drawn.

    Pictures only show what is there without them, so that no error of theirs may lose the rest.
    """
    return f"{place}: cannot be drawn: {type(error).__name__}: {one_line(error)}"


def write_scenario(folder: Path, application: Application, scenario: Scenario) -> Path:
    """Writes the resolved scenario with the versions that run it; it can be run again as it is."""
    kept, files = kept_files(application, replace(scenario, versions=versions()))
    for name, source in files.items():
        write_within(folder, name, partial(shutil.copyfile, source))
    return write_text(folder / SCENARIO_FILE, yaml_dump_typed(kept))


def without_nan(value: Any) -> Any:
    """The same nested value with None for what JSON cannot hold: NaN and infinities.

    Numbers and truth values of NumPy become Python's.
    """
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, np.generic):
        return without_nan(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def checksum(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _is_whole(folder: Path, summary: dict[str, Any]) -> bool:
    """Whether all files are there that the summary names, as they were when it was written."""
    names, sums = summary.get("files"), summary.get("checksums", {})
    if not isinstance(names, list) or not isinstance(sums, dict):
        return False
    try:
        return all(
            is_within(folder, name)
            and (folder / name).is_file()
            and sums.get(name) in (None, checksum(folder / name))
            for name in names
        )
    except OSError:
        return False


def finished_summary(
    folder: Path, application: Application, scenario: Scenario
) -> dict[str, Any] | None:
    """The summary of a complete run of this very scenario, seed and program, if there is one."""
    summary = read_summary(folder)
    if not summary or summary.get("interrupted") or not _is_whole(folder, summary):
        return None
    current = {"seed": scenario.seed, **fingerprint(application, scenario)}
    return summary if all(summary.get(key) == value for key, value in current.items()) else None
