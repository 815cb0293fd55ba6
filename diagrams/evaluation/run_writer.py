"""Writes the files of an episode: what was perceived, what came of it, and a page to read."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.diagrams.evaluation.estimates import estimates_table
from crossmodal.diagrams.run.application import Application, Results
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.folder.kept_files import kept_files
from crossmodal.diagrams.run.folder.perceived_file import PERCEIVED_FILE, as_text, perceived
from crossmodal.diagrams.run.folder.run_folder import (
    ESTIMATES_FILE,
    LOG_FILE,
    MESHCAT_FILE,
    PAGE_FILE,
    PLOT_FOLDER,
    SCENARIO_FILE,
    SENSORS_FILE,
    SUMMARY_FILE,
    VIDEO_FILE,
    checksum,
    files_of_run,
    remove_run,
    undrawn,
    without_nan,
    write_scenario,
)
from crossmodal.diagrams.run.folder.written_files import write_within
from crossmodal.diagrams.run.own_code import place_of, told, traceback_of
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line


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
        self._names += [LOG_FILE] if log else []
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
        self._write(ESTIMATES_FILE, self._write_table)
        if PERCEIVED_FILE in self._names:
            text = as_text(self._perceived)
            self._write(PERCEIVED_FILE, lambda path: path.write_text(text, encoding="utf-8"))
        if self._log:
            self._write(LOG_FILE, lambda path: path.write_text(self._log, encoding="utf-8"))
        if {SCENARIO_FILE, ESTIMATES_FILE} <= {path.name for path in self.written}:
            self._write_summary()

    def _write_table(self, path: Path) -> None:
        try:
            self._results.estimates.to_parquet(path, index=False)
        except OSError:
            raise
        except Exception as error:  # Such as a column of mixed types.
            place = self._folder / ESTIMATES_FILE
            raise ScenarioError(f"{place}: cannot be written: {one_line(error)}") from error

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
        try:
            text = self._page()
            self._write(PAGE_FILE, lambda path: path.write_text(text, encoding="utf-8"))
        except Exception as error:
            self.missing.append(undrawn(self._folder / PAGE_FILE, error))
            self._names.remove(PAGE_FILE)
        if any(path.name == SUMMARY_FILE for path in self.written):
            there = [name for name in self._names if (self._folder / name).is_file()]
            self.summary["checksums"] = {name: checksum(self._folder / name) for name in there}
            self._write_summary()

    def _page(self) -> str:
        """What came of the run, with its pictures, which the page finds in the folder."""
        from crossmodal.diagrams.evaluation.run_report import run_page

        there = [SUMMARY_FILE, *self._names]
        return run_page(
            self._application,
            self._record.scenario,
            self.summary,
            self._results.report(self.summary),
            [name for name in there if (self._folder / name).is_file()],
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


def evaluated(application: Application, record: EpisodeRecord) -> Results:
    """What an episode comes to, also where code of a user's own broke off or cannot evaluate it."""
    try:
        results = application.evaluate(record)
    except Exception as error:
        if not record.failure and not place_of(error):
            raise
        if not record.failure:
            record.failure, record.traceback = told(error), traceback_of(error)
        results = Results(failure=None, estimates=estimates_table({}), summary={"modalities": {}})
    return replace(results, failure=record.failure) if record.failure else results


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
