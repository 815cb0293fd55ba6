"""The metrics of an experiment's episodes as a tidy table, and their summary in Markdown."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from crossmodal.diagrams.drawing.digits import written, written_range
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Experiment, Metric, Reference
from crossmodal.maths.arrays import Array

Summary = dict[str, Any]
_FOR_QUANTILES = 20  # Episodes of which 5 % are one.
_FOR_TWO_DIGITS = 10  # Episodes from which on the error of a deviation is below a quarter of it.
COLUMNS = ("experiment", "seed", "modality", "metric", "value", "unit", "reason")
# What metrics are written in for people: factor and unit, by their unit in SI.
READABLE = {
    "m": (1000.0, "mm"),
    "rad": (180.0 / math.pi, "deg"),
    "m/s": (1000.0, "mm/s"),
    "rad/s": (180.0 / math.pi, "deg/s"),
    "m/rad": (1000.0, "mm/rad"),
    "B": (1e-9, "GB"),
    "share": (100.0, "%"),  # Of one.
}


def readable(unit: str) -> tuple[float, str]:
    """Factor and unit in which values in an SI unit are written for people."""
    return READABLE.get(unit, (1.0, unit))


def value_at(path: str) -> Callable[[Mapping[str, Any]], Any]:
    """Reads what stands in a summary, or in a part of it, under keys with points between them.

    It raises a KeyError where an episode has nothing of the kind.
    """

    def value(record: Any) -> Any:
        for key in path.split("."):
            if record is None:
                raise KeyError(path)
            record = record[int(key) if isinstance(record, list) else key]
        return record

    return value


def metrics_of(application: Application) -> dict[str, Metric]:
    """All metrics of an application's episodes, by name."""
    every = (*EPISODE_METRICS, *application.metrics, *TICK_METRICS)
    return {metric.name: metric for metric in every}


def tidy_metrics(application: Application, name: str, summaries: Sequence[Summary]) -> pd.DataFrame:
    """One row per episode, estimator and metric.

    Columns: `experiment`, `seed`, `modality` (the estimator; empty for metrics of the whole
    episode), `metric`, `value` (SI and rad; 0 or 1 for what is false or true; NaN
    where there is none), `unit` and `reason` (beside a `success` of 0, why). An episode that broke
    off has only the metrics of the whole episode.
    """
    rows: list[dict[str, Any]] = []
    for summary in summaries:
        parts = [("", summary), *summary.get("modalities", {}).items()]
        for modality, record in parts:
            for metric in metrics_of(application).values():
                if metric.by_estimator != bool(modality):
                    continue
                try:
                    value = metric.value(record)
                except KeyError:
                    continue
                failed = metric.name == "success" and value is False
                rows.append(
                    {
                        "experiment": name,
                        "seed": summary["seed"],
                        "modality": modality,
                        "metric": metric.name,
                        "value": math.nan if value is None else float(value),
                        "unit": metric.unit_in(record),
                        "reason": (summary.get("failure") or "unknown") if failed else "",
                    }
                )
    return pd.DataFrame(rows, columns=list(COLUMNS))


def is_summary(application: Application, summary: Summary) -> bool:
    """Whether an episode of the application can have written it."""
    try:
        tidy_metrics(application, "", [summary])
        types = type(summary["seed"]), type(summary["modalities"])
        return types == (int, dict) and summary["success"] in (True, False, None)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return False


def quantile(values: npt.ArrayLike, share: float) -> Array:
    """Quantile of magnitudes (n, ...) over the first axis, linear between neighbours.

    NaN counts as infinitely large.
    """
    known = np.asarray(values, dtype=float)
    magnitudes = np.sort(np.where(np.isnan(known), np.inf, np.abs(known)), axis=0)
    place = share * (len(magnitudes) - 1)
    low, high = magnitudes[math.floor(place)], magnitudes[math.ceil(place)]
    with np.errstate(invalid="ignore"):  # Between two infinite ones, which stay as they are.
        between = low + (place - math.floor(place)) * (high - low)
    return np.where((low == high) | (place == math.floor(place)), low, between)


# Cells of a table: from one value per episode, NaN for those that have none, and their unit.


def median_and_range(values: npt.ArrayLike, unit: str) -> str:
    """'median (5 % to 95 %) unit' of magnitudes in SI; 'none' for what is missing.

    Of fewer than twenty episodes the least and the largest stand in the brackets, and of one its
    magnitude alone. There are as many digits as the median's standard error leaves.
    """
    values = np.asarray(values, dtype=float)
    if not np.any(np.isfinite(values)):
        return "none"
    scale, shown = readable(unit)
    if len(values) == 1:
        return written(scale * abs(float(values[0])), shown)
    tail = 0.05 if len(values) >= _FOR_QUANTILES else 0.0
    low, median, high = (
        scale * float(quantile(values, share)) for share in (tail, 0.5, 1.0 - tail)
    )
    return written_range(low, median, high, shown, error=scale * median_error(values))


def one_figure(value: Any, unit: str, *, significant: int = 2) -> str:
    """A single episode's: 'yes' or 'no', or the magnitude of a number in SI."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    scale, shown = readable(unit)
    return written(scale * abs(float(value)), shown, significant=significant)


def median_error(values: Array) -> float:
    """Standard error of the median of magnitudes, as of a normal distribution."""
    low, median, high = (float(quantile(values, share)) for share in (0.25, 0.5, 0.75))
    quartile = 0.5 * (high - low) if math.isfinite(high) else median - low
    return 1.2533 * quartile / 0.6745 / math.sqrt(len(values))


def mean_and_deviation(values: npt.ArrayLike, unit: str) -> str:
    """'mean ± standard deviation unit' of magnitudes in SI, of the episodes that have one."""
    known, without = _known(values)
    if len(known) == 0:
        return "-"
    scale, shown = readable(unit)
    deviation = float(np.std(np.abs(known), ddof=1)) if len(known) > 1 else math.nan
    digits = 1 if len(known) < _FOR_TWO_DIGITS else 2
    mean = scale * float(np.mean(np.abs(known)))
    text = written(mean, shown, spread=scale * deviation, of_spread=digits)
    return text + _in_brackets(without)


def count(values: npt.ArrayLike, unit: str = "") -> str:
    """'so many/of all'."""
    values = np.asarray(values, dtype=float)
    return f"{int(np.sum(values == 1.0))}/{len(values)}"


def count_of_known(values: npt.ArrayLike, unit: str = "", *, with_share: bool = False) -> str:
    """'so many/of those that have a value', the share of these, and how many have none."""
    known, without = _known(values)
    if len(known) == 0:
        return "-"
    is_shown = with_share and len(known) >= _FOR_QUANTILES
    share = [f"{100.0 * np.mean(known == 1.0):.0f} %"] if is_shown else []
    return count(known) + _in_brackets(share + without)


def mean_share(values: npt.ArrayLike, unit: str = "") -> str:
    """Mean of shares in percent, of the episodes that have one."""
    known, _ = _known(values)
    return f"{100.0 * np.mean(known):.0f} %" if len(known) else "-"


def total(values: npt.ArrayLike, unit: str = "") -> str:
    """Sum over the episodes that have one."""
    known, _ = _known(values)
    return f"{np.sum(known):.0f}" if len(known) else "-"


def milliseconds(values: npt.ArrayLike, unit: str) -> str:
    """Median and range of times in seconds, written in milliseconds."""
    known, _ = _known(values)
    return median_and_range(1000.0 * known, "") + " ms" if len(known) else "-"


def _known(values: npt.ArrayLike) -> tuple[Array, list[str]]:
    """The values that there are, and in words how many there are not."""
    values = np.asarray(values, dtype=float)
    known = values[np.isfinite(values)]
    missing = len(values) - len(known)
    return known, [f"{missing} without"] if missing else []


def _in_brackets(remarks: Sequence[str]) -> str:
    return f" ({', '.join(remarks)})" if remarks else ""


def _of_episode(name: str, unit: str = "", **shown: Any) -> Metric:
    return Metric(name=name, value=value_at(name), unit=unit, by_estimator=False, **shown)


# Of every application.
EPISODE_METRICS = (
    _of_episode("success", title="done", cell=count_of_known, totals=True, better="more"),
    _of_episode("duration", "s"),
    _of_episode("wall_time", "s"),
    _of_episode("real_time_factor"),
    _of_episode("peak_memory", "B"),
)
TICK_METRICS = (
    Metric(
        name="tick_median",
        value=value_at("tick.median"),
        unit="s",
        title="tick",
        cell=milliseconds,
    ),
    Metric(name="tick_p95", value=value_at("tick.p95"), unit="s"),
)
# They show how busy the machine was.
OF_THE_MACHINE = ("wall_time", "real_time_factor", "peak_memory", "tick_median", "tick_p95")


def values_of(figures: pd.DataFrame, metric: str, modality: str) -> tuple[Array, str] | None:
    """One value per episode, NaN for those that broke off, and the unit; None where unknown."""
    chosen = figures[(figures["metric"] == metric) & (figures["modality"] == modality)]
    if chosen.empty:
        return None
    by_seed = chosen.set_index("seed")["value"]
    return by_seed.reindex(figures["seed"].unique()).to_numpy(float), str(chosen["unit"].iloc[0])


def estimators_of(application: Application, figures: pd.DataFrame) -> list[str]:
    """The estimators that there are: first those with a label, in the labels' order."""
    found = dict.fromkeys(name for name in figures["modality"] if name)
    known = [name for name in application.labels if name in found]
    return [*known, *(name for name in found if name not in known)]


def label(application: Application, estimator: str) -> str:
    """What a reader calls an estimator."""
    return application.labels.get(estimator, estimator)


def _cells(figures: pd.DataFrame, metric: Metric, estimators: Sequence[str]) -> list[str] | None:
    found = [values_of(figures, metric.name, estimator) for estimator in estimators]
    if metric.cell is None or all(values is None for values in found):
        return None
    return ["-" if values is None else metric.cell(*values) for values in found]


def experiment_tables(
    application: Application,
    experiment: Experiment,
    figures: pd.DataFrame,
    asked: Sequence[int] = (),
) -> list[Table]:
    """The tables of the whole episodes and of the estimators.

    Each stands beside paper and goal, where the experiment names any for its metrics, and says in
    its corner where episodes are missing.

    Args:
        asked: The seeds that there should be; none: those that there are.
    """
    there = figures["seed"].nunique()
    corner = interrupted(there, len(asked)) if there < len(asked) else ""
    estimators = estimators_of(application, figures)
    tables = []
    for by_estimator, columns, header in (
        (False, [""], ["all episodes"]),
        (True, estimators, [label(application, name) for name in estimators]),
    ):
        rows: dict[str, list[str]] = {}  # By the metric's name.
        for metric in metrics_of(application).values():
            if metric.by_estimator != by_estimator or metric.name in experiment.without:
                continue
            cells = _cells(figures, metric, columns)
            if cells is not None:
                rows[metric.name] = [metric.title, *cells]
        references = {name: experiment.references.get(name, Reference()) for name in rows}
        kinds = ("paper", "goal")
        beside = [kind for kind in kinds if any(getattr(r, kind) for r in references.values())]
        for name, row in rows.items():
            row += [getattr(references[name], kind) for kind in beside]
        if rows:
            tables.append(Table(header=[corner, *header, *beside], rows=list(rows.values())))
    return tables


def failures_table(figures: pd.DataFrame) -> Table:
    """Seeds of the episodes that failed, and why."""
    failed = figures[(figures["metric"] == "success") & (figures["value"] == 0.0)]
    rows = [[str(seed), reason] for seed, reason in zip(failed.seed, failed.reason, strict=True)]
    return Table(header=["seed", "why the task was not done"], rows=rows)


def seed_ranges(seeds: Sequence[int]) -> str:
    """'100 to 119' for seeds in a row, else all of them."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def interrupted(there: int, asked: int) -> str:
    """'7 of 27, interrupted'."""
    return f"{there} of {asked}, interrupted"


def title(name: str, figures: pd.DataFrame, asked: Sequence[int] = ()) -> str:
    """How many episodes and of which seeds, and which were asked for where some are missing."""
    seeds = [int(seed) for seed in figures["seed"].unique()]
    if len(seeds) < len(asked):
        missing = interrupted(len(seeds), len(asked))
        return f"{name}: {missing}: seeds {seed_ranges(seeds)} of {seed_ranges(asked)}"
    episodes = "1 episode" if len(seeds) == 1 else f"{len(seeds)} episodes"
    return f"{name}: {episodes}, seeds {seed_ranges(seeds)}"


def running_notes(figures: pd.DataFrame) -> list[str]:
    """What the computer did: real-time factor and memory."""
    found = (values_of(figures, name, "") for name in ("real_time_factor", "peak_memory"))
    factor, memory = (np.zeros(0) if one is None else _known(one[0])[0] for one in found)
    notes = []
    if len(factor):
        notes.append(f"Real-time factor: median {np.median(factor):.2f}, least {min(factor):.2f}.")
    if len(memory):
        notes.append(f"Peak memory of an episode: at most {max(memory) / 1e9:.2f} GB.")
    return notes


HOW_TO_READ = (
    "How to read a cell: median (5 % to 95 % of the episodes, of fewer than 20 the least and the"
    " largest) of the magnitude, where what is missing counts as infinitely large ('none'); or mean"
    " ± standard deviation; or in how many of how many episodes. '-' is what nobody knows."
)


def markdown(
    application: Application,
    name: str,
    experiment: Experiment,
    figures: pd.DataFrame,
    made_by: str,
    task: str = "",
    asked: Sequence[int] = (),
) -> str:
    """An experiment's tables and its failures in Markdown.

    Args:
        asked: The seeds that there should be; none: those that there are.
        made_by: How the figures were made: command, version and date.
        task: What counts as done, in a sentence.
    """
    parts = [f"# {title(name, figures, asked)}", made_by]
    tables = experiment_tables(application, experiment, figures, asked)
    parts += [table.markdown() for table in tables]
    notes = [*([task] if task else []), *experiment.notes]
    parts += ["\n".join(f"- {note}" for note in notes)]
    parts += [HOW_TO_READ, *running_notes(figures)]
    failures = failures_table(figures)
    if failures.rows:
        parts.append(failures.markdown())
    return "\n\n".join(filter(None, parts)) + "\n"


def overall_table(
    application: Application,
    figures: Mapping[str, pd.DataFrame],
    asked: Mapping[str, Sequence[int]] | None = None,
) -> Table:
    """One row per experiment, by name, beside the paper's errors, and one of all of them.

    Args:
        asked: The seeds that there should be, by experiment; none: those that there are.
    """
    there = {name: frame["seed"].nunique() for name, frame in figures.items()}
    wanted = there | {name: len(seeds) for name, seeds in (asked or {}).items()}
    metrics, columns = metrics_of(application), application.overview
    table = Table(header=["experiment", *(column.header for column in columns), "paper", "goal"])
    flags: dict[int, list[Array]] = {}
    for name, frame in figures.items():
        experiment = application.experiments[name]
        missing = there[name] < wanted[name]
        cells = [f"{name}: {interrupted(there[name], wanted[name])}" if missing else name]
        for index, column in enumerate(columns):
            metric = metrics[column.metric]
            found = values_of(frame, metric.name, column.estimator)
            if metric.totals:
                found = found or (np.full(frame["seed"].nunique(), np.nan), "")
                # Episodes that broke off count here too.
                known = np.where(np.isnan(found[0]) & _broke_off(frame), 0.0, found[0])
                flags.setdefault(index, []).append(known)
            shown = found is not None and len(found[0]) and metric.name not in experiment.without
            cells.append(metric.cell(*found) if shown and found and metric.cell else "-")
        compared = dict.fromkeys(c.metric for c in columns if not metrics[c.metric].totals)
        references = [experiment.references.get(key, Reference()) for key in compared]
        for kind in ("paper", "goal"):
            texts = filter(None, (getattr(reference, kind) for reference in references))
            cells.append(" / ".join(texts) or "-")
        table.rows.append(cells)
    ended, all_asked = sum(there.values()), sum(wanted.values())
    totals = [""] * len(columns)
    for index, values in flags.items():
        totals[index] = count_of_known(np.concatenate(values), with_share=ended == all_asked)
    heading = "all" if ended == all_asked else f"all: {interrupted(ended, all_asked)}"
    table.rows.append([heading, *totals, "", ""])
    return table


def _broke_off(figures: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Of which of the episodes there is nothing of any estimator."""
    ended = figures.loc[figures["modality"] != "", "seed"].unique()
    return ~np.isin(figures["seed"].unique(), ended)
