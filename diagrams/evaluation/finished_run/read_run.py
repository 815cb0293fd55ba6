"""What the folder of a finished run has to show, wherever the folder comes from.

It may have been copied, moved or cut short, and another machine or version may have written it. So
nothing of it is taken for granted: what cannot be shown is left out, with a line that says so. No
link is followed out of the folder.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from crossmodal.diagrams.drawing.plot_style import Panel, read_panels
from crossmodal.diagrams.evaluation.estimates import COLUMNS
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.run_folder import (
    ESTIMATES_FILE,
    MESHCAT_FILE,
    PAGE_FILE,
    PLOT_FOLDER,
    SCENARIO_FILE,
    SUMMARY_FILE,
    read_summary,
)
from crossmodal.diagrams.run.folder.written_files import is_within
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

_KEYS = ["modality", "quantity", "component"]
_SAME = 1e-9  # Truths that differ by less are the same.
_NUMBERS = ["time", "estimate", "std", "truth"]


@dataclass(kw_only=True)
class FinishedRun:
    """What there is to show of a run.

    Attributes:
        folder: Where it is.
        name: Of the scenario, or else of the folder.
        seed: As it was written; empty where that is not known.
        description: Of the scenario.
        outcome: Whether the task was done, in words.
        success: The same; None where nobody knows.
        events: What happened: its time [s] and name.
        estimates: Of the columns that `Results.estimates` has, `time` to `component` as text and
            numbers, `estimate`, `std` and `truth`; empty where there are none.
        labels: What estimators are called.
        colors: Theirs.
        has_scene: Whether there is a recording of Meshcat's.
        pictures: The figures by their paths in the folder, and where in them time runs.
        missing: What cannot be shown and why, a line each.
    """

    folder: Path
    name: str
    seed: str = ""
    description: str = ""
    outcome: str = "It is not known whether the task was done."
    success: bool | None = None
    events: list[tuple[float, str]] = field(default_factory=list)
    estimates: pd.DataFrame = field(default_factory=lambda: _no_estimates())
    labels: Mapping[str, str] = field(default_factory=dict)
    colors: Mapping[str, str] = field(default_factory=dict)
    has_scene: bool = False
    pictures: dict[str, list[Panel]] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    @property
    def estimators(self) -> list[str]:
        """Those that the table of estimates names, in its order."""
        return list(dict.fromkeys(self.estimates["modality"]))

    @property
    def quantities(self) -> list[str]:
        """Those that were estimated, first those whose truth is known and which most estimate."""
        by_quantity = self.estimates.groupby("quantity", sort=False)
        is_known, many = by_quantity["truth"].count() > 0, by_quantity["modality"].nunique()
        return sorted(is_known.index, key=lambda name: (not is_known[name], -many[name]))


def read_finished_run(
    folder: Path, find_application: Callable[[str, str], Application]
) -> FinishedRun:
    """Reads the folder of a run as far as it goes.

    Args:
        find_application: From what a scenario's `system` says, and its file, to the application.

    Raises:
        ScenarioError: where there is nothing to show.
    """
    run = FinishedRun(folder=folder, name=folder.resolve().name)
    run.has_scene = is_within(folder, MESHCAT_FILE) and (folder / MESHCAT_FILE).is_file()
    _read_pictures(run)
    summary = read_summary(folder)
    there = is_within(folder, ESTIMATES_FILE) and (folder / ESTIMATES_FILE).is_file()
    if not (run.has_scene or run.pictures or summary or there):
        raise ScenarioError(_nothing_to_show(folder))
    if not run.has_scene:
        again = f"`crossmodal run {folder / SCENARIO_FILE}`"
        run.missing.append(
            f"The scene is not shown: there is no {MESHCAT_FILE}, which is written neither by"
            " evaluations and replays nor where a station has no output `cheat_query_object`;"
            f" {again} simulates an episode again."
        )
    _read_scenario(run, find_application)
    _read_outcome(run, summary)
    if there:
        _read_estimates(run)
    else:
        run.missing.append(f"No estimates are shown: there is no {ESTIMATES_FILE}.")
    return run


def _nothing_to_show(folder: Path) -> str:
    """What to show instead, in a line."""
    runs = sorted({*folder.glob(f"*/{SUMMARY_FILE}"), *folder.glob(f"*/*/{SUMMARY_FILE}")})
    if runs:
        page, text = folder / PAGE_FILE, f"{folder}: holds {len(runs)} runs"
        text += f"; show one of them, as crossmodal show {runs[0].parent}"
        return f"{text}; open {page} in a browser for all together" if page.is_file() else text
    return (
        f"{folder}: holds nothing of a run: neither {SUMMARY_FILE}, {ESTIMATES_FILE},"
        f" {MESHCAT_FILE} nor {PLOT_FOLDER}/*.png; name a folder that `crossmodal run` has written"
    )


def _read_pictures(run: FinishedRun) -> None:
    unmarked = []
    for path in sorted((run.folder / PLOT_FOLDER).glob("*.png")):
        name = f"{PLOT_FOLDER}/{path.name}"
        if not is_within(run.folder, name) or not path.is_file():
            run.missing.append(f"{name} is not shown: it is a link out of the folder or no file.")
            continue
        try:
            panels = read_panels(path)
        except (OSError, ValueError, SyntaxError) as error:
            run.missing.append(f"{name} is not shown: it is damaged: {one_line(error)}.")
            continue
        run.pictures[name] = panels or []
        unmarked += [path.name] if panels is None else []
    if unmarked:
        run.missing.append(
            f"No cursor is shown in {', '.join(unmarked)}: another version drew them, which did not"
            " write where in them time runs."
        )


def _read_scenario(run: FinishedRun, find_application: Callable[[str, str], Application]) -> None:
    try:
        if not is_within(run.folder, SCENARIO_FILE):
            raise ScenarioError(f"{SCENARIO_FILE} is a link out of the folder")
        document = read_yaml(run.folder / SCENARIO_FILE)
        run.name = str(document.get("name") or run.name)
        run.description = str(document.get("description") or "")
        run.seed = str(document.get("seed", ""))
        application = find_application(str(document.get("system", "")), SCENARIO_FILE)
        run.labels, run.colors = application.labels, application.colors
    except ScenarioError as error:
        run.missing.append(
            "Estimators go by the names that the files give them:"
            f" {one_line(error).removeprefix(f'{run.folder}/')}."
        )


def _read_outcome(run: FinishedRun, summary: Mapping[str, Any]) -> None:
    if not summary:
        run.missing.append(
            f"Outcome and events are not known: {SUMMARY_FILE} is not there or is damaged."
        )
        return
    run.seed = run.seed or str(summary.get("seed", ""))
    if isinstance(summary.get("success"), bool):
        run.success = summary["success"]
        reason = summary.get("failure")
        run.outcome = "done" if run.success else f"not done: {reason or 'the reason is not known'}"
    events = summary.get("events")
    for event in events if isinstance(events, list) else []:
        time = event.get("time") if isinstance(event, dict) else None
        if isinstance(time, int | float) and np.isfinite(time):
            run.events.append((float(time), str(event.get("name", ""))))


def _no_estimates() -> pd.DataFrame:
    return pd.DataFrame({key: pd.Series(dtype=float) for key in [*_KEYS, *_NUMBERS]})


def _read_estimates(run: FinishedRun) -> None:
    try:
        table = pd.read_parquet(run.folder / ESTIMATES_FILE)
        lacking = [name for name in COLUMNS if name in ("time", *_KEYS) and name not in table]
        if lacking:
            raise ValueError(f"it has no column {', '.join(lacking)}")
        table = table.reindex(columns=[*_KEYS, *_NUMBERS])
        table[_KEYS] = table[_KEYS].astype(str)
        table[_NUMBERS] = table[_NUMBERS].apply(pd.to_numeric, errors="coerce")
    except Exception as error:  # Whatever a damaged or foreign file makes a reader raise.
        run.missing.append(
            f"No estimates are shown: {ESTIMATES_FILE} cannot be read: {one_line(error)}."
        )
        return
    table = table[np.isfinite(table["time"])]
    run.estimates = table.drop_duplicates(["time", *_KEYS], keep="last")


def values_over_time(run: FinishedRun) -> dict[str, Any]:
    """The estimates, ready for JSON: what is not known is None.

    Returns:
        `times` (T,) [s], and `rows`, one for each quantity and component, and for each truth where
        estimators have different ones: its `truth` (T,) and, in `series`, by estimator, its
        `estimate` (T,) and the reported deviation `std` (T,).
    """
    times = np.unique(run.estimates["time"])
    rows = [
        _row(str(quantity), str(component), part, times)
        for quantity in run.quantities
        for component, found in run.estimates[run.estimates["quantity"] == quantity].groupby(
            "component", sort=False
        )
        for part in _of_one_truth(found)
    ]
    return {"times": _for_json(pd.Series(times)), "rows": rows}


def _of_one_truth(found: pd.DataFrame) -> list[pd.DataFrame]:
    """A quantity's estimates; estimator by estimator where each has a frame of its own."""
    truths = found.groupby("time")["truth"]
    if (truths.max() - truths.min()).max() > _SAME:
        return [part for _, part in found.groupby("modality", sort=False)]
    return [found]


def _row(quantity: str, component: str, found: pd.DataFrame, times: Any) -> dict[str, Any]:
    by_estimator = {
        str(name): part.set_index("time").reindex(times)
        for name, part in found.groupby("modality", sort=False)
    }
    truth = found.dropna(subset="truth").drop_duplicates("time").set_index("time")["truth"]
    return {
        "quantity": quantity,
        "component": component,
        "truth": _for_json(truth.reindex(times)),
        "series": {
            name: {key: _for_json(part[key]) for key in ("estimate", "std")}
            for name, part in by_estimator.items()
        },
    }


def _for_json(values: pd.Series) -> list[float | None]:
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]
