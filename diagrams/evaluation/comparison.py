"""Runs and evaluations side by side: their figures, what differs in their scenarios, pictures."""

import contextlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from crossmodal.diagrams.drawing.digits import fixed, written
from crossmodal.diagrams.drawing.page import Section, page
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.campaign_report import inline
from crossmodal.diagrams.evaluation.metric_table import (
    OF_THE_MACHINE,
    Summary,
    count,
    is_summary,
    label,
    mean_share,
    median_and_range,
    median_error,
    metrics_of,
    one_figure,
    quantile,
    readable,
    seed_ranges,
    tidy_metrics,
    values_of,
)
from crossmodal.diagrams.evaluation.words import words_of
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.folder.run_folder import (
    PLOT_FOLDER,
    SCENARIO_FILE,
    SUMMARY_FILE,
    read_summary,
)
from crossmodal.diagrams.run.folder.written_files import is_within
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.diagrams.run.yaml_input.values_table import unit_at
from crossmodal.maths.arrays import Array

_Kind = Literal["truth", "share", "magnitude"]
_LONGEST = 80  # Letters of a scenario's value in a cell.
MAIN_ROWS = 8
HOW_TO_COMPARE = (
    "One run has a magnitude; an evaluation the median (5 % to 95 % of the episodes, of fewer than"
    " 20 the least and the largest), where what is missing counts as infinitely large ('none'), the"
    " mean of shares, or in how many of how many episodes something is so. Coloured is what is"
    " better or worse, of evaluations by more than twice the standard error."
)
_SAME = "Their scenarios say the same."
_DIGITS = 3  # Of one run's figure: its neighbour may be close.
_SHOWN = 0.5 * 10.0**-_DIGITS  # What differs by a smaller share looks the same.


@dataclass(kw_only=True)
class Compared:
    """A run or an evaluation.

    Attributes:
        name: By which the comparison calls it.
        application: What ran it.
        document: Its scenario as it was written, flat: values by `key.path`; of an evaluation that
            of its first episode, without the seed.
        summaries: One of a run, of an evaluation one of each episode, in order of the seeds.
        figures: Their metrics, see `tidy_metrics`.
        pictures: By name.
    """

    name: str
    application: Application
    document: dict[str, Any]
    summaries: list[Summary]
    figures: pd.DataFrame
    pictures: dict[str, Path]

    @property
    def heading(self) -> str:
        """Its name, and of which episodes it is."""
        seeds = [int(summary["seed"]) for summary in self.summaries]
        if len(seeds) == 1:
            return f"{self.name}: seed {seeds[0]}"
        return f"{self.name}: {len(seeds)} episodes, seeds {seed_ranges(seeds)}"


def read_compared(
    folder: Path, name: str, find_application: Callable[[str, str], Application]
) -> Compared:
    """Reads the folder of a run or of an evaluation.

    Args:
        name: What the comparison calls it.
        find_application: From what a scenario's `system` says, and its file, to the application.

    Raises:
        ScenarioError: where it is neither, or where a file there is damaged.
    """
    is_run = os.path.isfile(folder / SUMMARY_FILE)
    places = [folder]
    if not is_run and os.path.isdir(folder):
        places = [path.parent for path in sorted(folder.glob(f"seed-[0-9]*/{SUMMARY_FILE}"))]
    if not places or not os.path.isdir(folder):
        raise ScenarioError(
            f"{folder}: holds neither a {SUMMARY_FILE} nor episodes;"
            " name the folder of a run or of an evaluation"
        )
    if not is_within(folder, str((places[0] / SCENARIO_FILE).relative_to(folder))):
        raise ScenarioError(f"{places[0] / SCENARIO_FILE}: is a link out of {folder}")
    document = read_yaml(places[0] / SCENARIO_FILE)
    system = str(document.get("system", ""))
    application = find_application(system, str(places[0] / SCENARIO_FILE))
    if not is_run:
        document.pop("seed", None)
    summaries = [read_summary(place) for place in places]
    for place, summary in zip(places, summaries, strict=True):
        if not is_summary(application, summary):
            raise ScenarioError(
                f"{place / SUMMARY_FILE}: is no summary of a run of '{application.name}';"
                " run it again, or remove its folder"
            )
    pictures = folder / PLOT_FOLDER if is_run else folder
    return Compared(
        name=name,
        application=application,
        document=_flat(document),
        summaries=summaries,
        figures=tidy_metrics(application, name, summaries),
        pictures={
            path.stem.replace("_", " "): path
            for path in sorted(pictures.glob("*.png"))
            if is_within(folder, str(path.relative_to(folder))) and path.is_file()
        },
    )


def _flat(document: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in document.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{path}{key}.")
        else:
            found[f"{path}{key}"] = value
    return found


def figures_table(compared: Sequence[Compared]) -> Table:
    """A row per metric and estimator; what the others differ by from the first stands last.

    The metrics for which more or less is better come first, as the applications' overviews order
    them. What only shows how busy the machine was is left out. Values in another unit, as of a door
    beside a drawer, are not compared.

    One run has a magnitude, an evaluation the median of the magnitudes and their 5 to 95 %, the
    mean of shares, or how often something is true. What is missing counts as infinitely large, and
    as not true.
    """
    table = Table(header=["", "", *(one.name for one in compared)])
    table.header += [f"{one.name} - {compared[0].name}" for one in compared[1:]]
    for metric, estimator in _in_order(compared):
        found = [
            values_of(one.figures, metric.name, estimator)
            or (np.full(one.figures["seed"].nunique(), np.nan), "")
            for one in compared
        ]
        if not any(np.any(np.isfinite(values)) for values, _ in found):
            continue
        kind, (first, unit) = _kind(metric, compared), found[0]
        row = [
            metric.title or metric.name.replace("_", " "),
            label(compared[0].application, estimator),
            *(_cell(values, of_it, kind) for values, of_it in found),
        ]
        for values, of_it in found[1:]:
            text, tone = "-", ""
            if of_it == unit:
                text = _difference(first, values, unit, kind)
                tone = _tone(metric, first, values, kind)
            if tone:
                table.tones[len(table.rows), len(row)] = tone
            row.append(f"{text}, {'better' if tone == 'good' else 'worse'}" if tone else text)
        table.rows.append(row)
    return table


def _in_order(compared: Sequence[Compared]) -> list[tuple[Metric, str]]:
    """Metrics and estimators: those of the overview, those with a better and a worse, the rest."""
    metrics = {
        name: metric
        for one in compared
        for name, metric in metrics_of(one.application).items()
        if name not in OF_THE_MACHINE
    }
    estimators = dict.fromkeys(name for one in compared for name in one.figures["modality"])
    overview = [
        (metrics[column.metric], column.estimator)
        for one in compared
        for column in one.application.overview
    ]
    main = [estimator for _, estimator in overview if estimator][-1:]
    every = [(metric, name) for metric in metrics.values() for name in estimators]
    directed = [(metric, name) for metric, name in every if metric.better]
    of_main = [(metric, name) for metric, name in directed if name in ("", *main)]
    found = {(metric.name, name): (metric, name) for metric, name in
             [*overview, *of_main, *directed, *every]}  # fmt: skip
    return list(found.values())


def _middle(values: Array, kind: _Kind) -> tuple[float, float]:
    """What stands for all episodes, and its standard error."""
    if kind == "magnitude":
        error = median_error(values) if len(values) > 1 else 0.0
        return float(quantile(values, 0.5)), error
    known = values == 1.0 if kind == "truth" else values[np.isfinite(values)]
    return float(np.mean(known)), float(np.std(known)) / math.sqrt(len(known))


def _tone(metric: Metric, first: Array, other: Array, kind: _Kind) -> str:
    """'good' where the other is better, 'bad' where it is worse, by more than chance does."""
    if not metric.better or not np.any(np.isfinite(first)) or not np.any(np.isfinite(other)):
        return ""
    (before, error), (after, other_error) = (_middle(values, kind) for values in (first, other))
    change, error = after - before, math.hypot(error, other_error)
    if not np.isfinite([change, error]).all() or abs(change) <= 2.0 * error:
        return ""
    if math.isclose(before, after, rel_tol=_SHOWN):
        return ""
    return "good" if (change > 0.0) == (metric.better == "more") else "bad"


def _kind(metric: Metric, compared: Sequence[Compared]) -> _Kind:
    """What an episode's value is."""
    for summary in (summary for one in compared for summary in one.summaries):
        for record in summary["modalities"].values() if metric.by_estimator else [summary]:
            with contextlib.suppress(KeyError):
                if isinstance(metric.value(record), bool):
                    return "truth"
    return "share" if metric.cell is mean_share else "magnitude"


def _cell(values: Array, unit: str, kind: _Kind) -> str:
    """How often something is true, a mean share, a median and its range; or one episode's value."""
    if not np.any(np.isfinite(values)):
        return "-"
    if len(values) == 1:
        value = bool(values[0]) if kind == "truth" else values[0]
        return one_figure(value, unit, significant=_DIGITS)
    if kind == "truth":
        return count(values)
    return mean_share(values) if kind == "share" else median_and_range(values, unit)


def _difference(first: Array, other: Array, unit: str, kind: _Kind) -> str:
    if not (np.any(np.isfinite(first)) and np.any(np.isfinite(other))):
        return "-"
    if np.array_equal(first, other):
        return "same"
    if kind == "truth" and len(first) == len(other) == 1:
        return "differs"
    (before, _), (after, _) = (_middle(values, kind) for values in (first, other))
    if kind == "truth" or (kind == "share" and len(first) > 1):
        return f"{fixed(100.0 * (after - before), 0, signed=True)} %"
    if not np.isfinite([before, after]).all():
        return "-"
    if math.isclose(before, after, rel_tol=_SHOWN):
        return "same"
    scale, shown = readable(unit)
    return written(scale * (after - before), shown, signed=True)


def scenarios_table(compared: Sequence[Compared]) -> Table:
    """The keys in which the scenarios differ, with their units, and the values.

    Those that all of them have come first; descriptions stand elsewhere.
    """
    table = Table(header=["scenario", *(one.name for one in compared)])
    keys = dict.fromkeys(key for one in compared for key in one.document if key != "description")
    for key in sorted(keys, key=lambda key: any(key not in one.document for one in compared)):
        values = [one.document.get(key, "-") for one in compared]
        if any(value != values[0] for value in values):
            units = (unit_at(one.application.scenario, key) for one in compared)
            unit = next(filter(None, units), "")
            table.rows.append([f"{key} [{unit}]" if unit else key, *map(_short, values)])
    return table


def _short(value: Any) -> str:
    text = one_line(str(value))
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def comparison(compared: Sequence[Compared], *, most: int | None = MAIN_ROWS) -> str:
    """The tables in Markdown.

    Args:
        most: How many rows of each; None for all.
    """
    parts, differing = [_what_was_done(one) for one in compared], scenarios_table(compared)
    for table in (figures_table(compared), differing):
        more = len(table.rows) - len(table.rows[:most])
        parts += [table.markdown(most)] if table.rows else []
        parts += [f"{table.title}: {more}, see --all."] if more else []
    parts += [] if differing.rows else [_SAME]
    return "\n\n".join([*parts, ""])


def comparison_page(compared: Sequence[Compared], origin: str) -> str:
    """Pictures side by side, the tables, and then what else there is of pictures.

    Args:
        origin: How the comparison was made.
    """
    names = list(dict.fromkeys(name for one in compared for name in one.pictures))
    wanted = [Path(one.application.portrait).stem.replace("_", " ") for one in compared]
    names.sort(key=lambda name: name not in wanted)
    main, differing = figures_table(compared), scenarios_table(compared)
    main.fold = differing.fold = MAIN_ROWS
    begin = Section(
        title="",
        what=[_what_was_done(one) for one in compared],
        pictures=_beside(compared, names[0]) if names else (),
        tables=[main, differing],
        words=words_of(compared[0].application, [main]),
        notes=[HOW_TO_COMPARE, *([] if differing.rows else [_SAME])],
        side_by_side=True,
    )
    further = [
        Section(name=name, title=name, pictures=_beside(compared, name), side_by_side=True)
        for name in names[1:]
    ]
    return page(" | ".join(one.name for one in compared), origin, [begin, *further])


def _what_was_done(one: Compared) -> str:
    """Of which episodes it is, and the scenario in words."""
    said = one.document.get("description")
    return f"{one.heading}; {said}." if said else f"{one.heading}."


def _beside(compared: Sequence[Compared], name: str) -> list[tuple[str, str]]:
    """A picture of each of those that have it."""
    return [
        (inline(one.pictures[name]), f"{one.heading}, {name}")
        for one in compared
        if name in one.pictures
    ]
