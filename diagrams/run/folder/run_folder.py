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
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.run.application import Application, Results
from crossmodal.diagrams.run.folder.fingerprint import fingerprint, versions
from crossmodal.diagrams.run.folder.kept_files import kept_files
from crossmodal.diagrams.run.folder.perceived_file import PERCEIVED_FILE, as_text, perceived
from crossmodal.diagrams.run.record import EpisodeRecord
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


def is_within(folder: Path, name: object) -> bool:
    """Whether a path relative to a folder stays in it, and no link leads out of it."""
    if not isinstance(name, str):
        return False
    try:
        path = (folder / name).resolve()
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            path.stat()  # A name may be too long.
        return path.is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # No path can be so, or links lead in a circle.
        return False


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


def write_atomically(path: Path, write: Callable[[Path], Any]) -> Path:
    """Lets `write` fill a file beside `path`, then moves it there, where an empty folder may be."""
    partial = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(partial)
        with contextlib.suppress(OSError):
            path.rmdir()
        os.replace(partial, path)
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise ScenarioError(f"{path}: cannot be written: {reason}") from None
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_within(folder: Path, name: str, write: Callable[[Path], Any]) -> Path:
    """The same of a file of a folder's own.

    Raises:
        ScenarioError: where a folder in it is a link to somewhere else.
    """
    if not is_within(folder, os.path.dirname(name)):
        raise ScenarioError(f"{folder / name}: a link leads out of {folder}; remove it")
    return write_atomically(folder / name, write)


def write_text(path: Path, text: str) -> Path:
    return write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))


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


class RunWriter:
    """Writes the files of an episode, the small ones first, and goes on where one cannot be.

    Attributes:
        summary: What `summary.json` holds.
        written: The files that are there.
        missing: What is not there, and why, a line each.

    Args:
        folder: Of the run. A picture in it that is of no run is not replaced.
        results: Of the record.
        only_own: Whether pictures by the names of its own are of an earlier run in any case, as in
            an evaluation, where that run's summary may be lost.
        log: What happened; empty where somebody else keeps it.
    """

    def __init__(
        self,
        folder: Path,
        application: Application,
        record: EpisodeRecord,
        results: Results,
        *,
        only_own: bool = False,
        log: str = "",
    ) -> None:
        self._folder, self._earlier = folder, files_of_run(folder)
        if only_own:
            self._earlier += [f"{PLOT_FOLDER}/{name}" for name in results.plots]
        self._application, self._record, self._results = application, record, results
        self.missing = list(record.missing)
        self.written = [
            file for file in (record.sensors_file, record.video_file) if file is not None
        ]
        own = kept_files(application, record.scenario)[1]
        self._names = [SCENARIO_FILE, *own, ESTIMATES_FILE]
        self._perceived = perceived(application, record)
        self._names += [PERCEIVED_FILE] if self._perceived.estimators else []
        self._names += [f"{PLOT_FOLDER}/{name}" for name in results.plots]
        self._names += [MESHCAT_FILE] if record.meshcat_html is not None else []
        self._names += [SENSORS_FILE] if record.sensors_file is not None else []
        self._names += [PAGE_FILE, *([LOG_FILE] if log else [])]
        self._log = log
        self._names += [VIDEO_FILE] if record.video_file is not None else []
        self._names += [PAGE_FILE]
        self.summary = summarise(application, record, results)
        self.summary |= {"files": self._names, "checksums": {}}

    def write_results(self) -> None:
        """Writes scenario and estimates and, where both are there, the summary.

        Before, it removes the summary of an earlier run, without which the folder holds no run, and
        its files that this one does not write again.
        """
        remove_run(self._folder, kept=self._names)
        scenario = self._record.scenario
        self._try(lambda: write_scenario(self._folder, self._application, scenario))
        self._write(
            ESTIMATES_FILE, lambda path: self._results.estimates.to_parquet(path, index=False)
        )
        if PERCEIVED_FILE in self._names:
            text = as_text(self._perceived)
            self._write(PERCEIVED_FILE, lambda path: path.write_text(text, encoding="utf-8"))
        if self._log:
            self._write(LOG_FILE, lambda path: path.write_text(self._log, encoding="utf-8"))
        if {SCENARIO_FILE, ESTIMATES_FILE} <= {path.name for path in self.written}:
            self._write_summary()

    def _write_summary(self) -> None:
        text = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
        self._write(SUMMARY_FILE, lambda path: path.write_text(text, encoding="utf-8"))

    def write_pictures(self) -> None:
        """Writes what shows the results; it is large."""
        from crossmodal.diagrams.drawing.plot_style import save

        for name, draw in self._results.plots.items():
            file, figure = f"{PLOT_FOLDER}/{name}", None
            try:
                figure = draw()
                if figure is not None:
                    if file not in self._earlier and os.path.lexists(self._folder / file):
                        raise FileExistsError("a file is there that no run has drawn")
                    self._write(file, partial(save, figure))
            except Exception as error:
                self.missing.append(undrawn(self._folder / file, error))
                figure = None
            if figure is None:
                self._names.remove(file)
                if file in self._earlier:
                    (self._folder / file).unlink(missing_ok=True)
        page = self._record.meshcat_html
        if page is not None:
            self._write(MESHCAT_FILE, lambda path: path.write_text(page, encoding="utf-8"))
        self._write(PAGE_FILE, lambda path: path.write_text(self._page(), encoding="utf-8"))
        if any(path.name == SUMMARY_FILE for path in self.written):
            there = [name for name in self._names if (self._folder / name).is_file()]
            self.summary["checksums"] = {name: checksum(self._folder / name) for name in there}
            self._write_summary()

    def _page(self) -> str:
        """What came of the run, with its pictures, which the page finds in the folder."""
        from crossmodal.diagrams.drawing.page import render

        scenario, failure = self._record.scenario, self.summary["failure"]
        links = {
            "in 3D": MESHCAT_FILE,
            "video": VIDEO_FILE,
            "all figures": SUMMARY_FILE,
            "scenario": SCENARIO_FILE,
        }
        outcome = "done" if self.summary["success"] else "not known whether it was done"
        return render(
            Path(__file__).with_name("run_page.html.jinja"),
            heading=f"{scenario.name}, seed {scenario.seed}",
            failure=failure,
            outcome=f"failed: {failure}" if failure else outcome,
            links={text: name for text, name in links.items() if (self._folder / name).is_file()},
            lines=self._results.report(self.summary),
            pictures=[name for name in self._names if name.startswith(f"{PLOT_FOLDER}/")],
        )

    def _write(self, name: str, write: Callable[[Path], Any]) -> None:
        self._try(lambda: write_within(self._folder, name, write))

    def _try(self, write: Callable[[], Path]) -> None:
        try:
            path = write()
            if path not in self.written:
                self.written.append(path)
        except ScenarioError as error:
            self.missing.append(str(error))


def write_run(
    folder: Path, application: Application, record: EpisodeRecord, results: Results
) -> list[Path]:
    """Writes all files of an episode into a folder of its own and returns them.

    Raises:
        ScenarioError: where one could not be written; the others are there then.
    """
    writer = RunWriter(folder, application, record, results, only_own=True)
    writer.write_results()
    writer.write_pictures()
    if writer.missing:
        raise ScenarioError("; ".join(writer.missing))
    return writer.written


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
        "success": results.success if not record.interrupted else False,
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
