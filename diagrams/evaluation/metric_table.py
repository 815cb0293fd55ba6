"""The metrics of an experiment's episodes as a tidy table, and their summary in Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from crossmodal.diagrams.drawing.digits import written, written_range
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Experiment, Metric, Reference
from crossmodal.maths.arrays import Array

Summary = dict[str, Any]
COLUMNS = ("experiment", "seed", "modality", "metric", "value", "unit", "reason")
# What metrics are written in for people: factor and unit, by their unit in SI.
READABLE = {
    "m": (1000.0, "mm"),
    "rad": (180.0 / math.pi, "deg"),
    "m/s": (1000.0, "mm/s"),
    "rad/s": (180.0 / math.pi, "deg/s"),
    "m/rad": (1000.0, "mm/rad"),
    "s": (1.0, "s"),
    "B": (1e-9, "GB"),
    "N": (1.0, "N"),
}


def readable(unit: str) -> tuple[float, str]:
    """Factor and unit in which values in an SI unit are written for people."""
    return READABLE.get(unit, (1.0, unit))


def tidy_metrics(application: Application, name: str, summaries: Sequence[Summary]) -> pd.DataFrame:
    """One row per episode, estimator and metric.

    Columns: `experiment`, `seed`, `modality` (the estimator; empty for metrics of the whole
    episode), `metric`, `value` (SI and rad; 0 or 1 for what is false or true; NaN
    where there is none), `unit` and `reason` (beside a `success` of 0, why). An episode that broke
    off has only the metrics of the whole episode.
    """
    rows: list[dict[str, Any]] = []
    metrics = (*EPISODE_METRICS, *application.metrics, *TICK_METRICS)
    for summary in summaries:
        common = {"experiment": name, "seed": summary["seed"], "reason": ""}
        parts = [("", summary), *summary.get("modalities", {}).items()]
        for modality, record in parts:
            for metric in metrics:
                if metric.by_estimator != bool(modality):
                    continue
                try:
                    value = metric.value(record)
                except KeyError:
                    continue
                rows.append(
                    common
                    | {
                        "modality": modality,
                        "metric": metric.name,
                        "value": math.nan if value is None else float(value),
                        "unit": metric.unit_in(record),
                    }
                )
                if metric.name == "success" and value is False:
                    rows[-1]["reason"] = summary.get("failure") or "unknown"
    return pd.DataFrame(rows, columns=list(COLUMNS))


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


def median_and_range(values: npt.ArrayLike, unit: str) -> str:
    """'median (5 % to 95 %) unit' of magnitudes in SI; 'none' for what is missing."""
    values = np.asarray(values, dtype=float)
    if not np.any(np.isfinite(values)):
        return "none"
    scale, shown = readable(unit)
    low, median, high = (scale * float(quantile(values, share)) for share in (0.05, 0.5, 0.95))
    return written_range(low, median, high, shown)


def mean_and_deviation(values: npt.ArrayLike, unit: str) -> str:
    """'mean ± standard deviation unit' of magnitudes in SI, of the episodes that have one."""
    values = np.asarray(values, dtype=float)
    known = np.abs(values[np.isfinite(values)])
    if len(known) == 0:
        return "-"
    scale, shown = readable(unit)
    deviation = float(np.std(known, ddof=1)) if len(known) > 1 else math.nan
    text = written(scale * float(np.mean(known)), shown, spread=scale * deviation)
    missing = len(values) - len(known)
    return text + (f" ({missing} without)" if missing else "")


def count(values: npt.ArrayLike) -> str:
    """'so many/of all'."""
    values = np.asarray(values, dtype=float)
    return f"{int(np.sum(values == 1.0))}/{len(values)}"


def count_of_known(values: npt.ArrayLike) -> str:
    """'so many/of those that have a value', and how many have none."""
    values = np.asarray(values, dtype=float)
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return "-"
    without = len(values) - len(known)
    return f"{int(np.sum(known == 1.0))}/{len(known)}" + (
        f" ({without} without)" if without else ""
    )


def mean_share(values: npt.ArrayLike) -> str:
    """Mean of shares in percent, of the episodes that have one."""
    values = np.asarray(values, dtype=float)
    known = values[np.isfinite(values)]
    return f"{100.0 * np.mean(known):.0f} %" if len(known) else "-"


def milliseconds(values: Array, unit: str) -> str:
    """Median and range of times in seconds, written in milliseconds."""
    known = values[np.isfinite(values)]
    return median_and_range(1000.0 * known, "") + " ms" if len(known) else "-"


def _of_episode(name: str, unit: str = "", **shown: Any) -> Metric:
    return Metric(name=name, value=itemgetter(name), unit=unit, by_estimator=False, **shown)


# Of every application.
EPISODE_METRICS = (
    _of_episode("success", title="done", cell=lambda v, _: count_of_known(v), totals=True),
    _of_episode("duration", "s"),
    _of_episode("wall_time", "s"),
    _of_episode("real_time_factor"),
    _of_episode("peak_memory", "B"),
)
TICK_METRICS = (
    Metric(
        name="tick_median",
        value=lambda record: record["tick"]["median"],
        unit="s",
        title="tick",
        cell=milliseconds,
    ),
    Metric(name="tick_p95", value=lambda record: record["tick"]["p95"], unit="s"),
)


@dataclass(kw_only=True)
class Table:
    """Cells ready to be shown, the first of each row its title."""

    header: list[str]
    rows: list[list[str]] = field(default_factory=list)

    def markdown(self) -> str:
        lines = [self.header, ["---"] * len(self.header), *self.rows]
        return "\n".join(f"| {' | '.join(_escaped(line))} |" for line in lines)


def _escaped(cells: list[str]) -> list[str]:
    return [cell.replace("|", "\\|").replace("\n", " ") for cell in cells]


def _values(figures: pd.DataFrame, modality: str, figure: str) -> tuple[Array, str] | None:
    """One value per episode, NaN for those that broke off, and the unit; None where unknown."""
    chosen = figures[(figures["metric"] == figure) & (figures["modality"] == modality)]
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
    found = [_values(figures, estimator, metric.name) for estimator in estimators]
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

    Each stands beside paper and goal, where the experiment names any, and says in its corner where
    episodes are missing.

    Args:
        asked: The seeds that there should be; none: those that there are.
    """
    there = figures["seed"].nunique()
    corner = interrupted(there, len(asked)) if there < len(asked) else ""
    estimators = estimators_of(application, figures)
    metrics = (*EPISODE_METRICS, *application.metrics, *TICK_METRICS)
    references = experiment.references.values()
    beside = [kind for kind in ("paper", "goal") if any(getattr(r, kind) for r in references)]
    tables = []
    for by_estimator, columns, header in (
        (False, [""], ["all episodes"]),
        (True, estimators, [label(application, name) for name in estimators]),
    ):
        table = Table(header=[corner, *header, *beside])
        for metric in metrics:
            if metric.by_estimator != by_estimator or metric.name in experiment.without:
                continue
            cells = _cells(figures, metric, columns)
            if cells is not None:
                reference = experiment.references.get(metric.name, Reference())
                table.rows.append(
                    [metric.title, *cells, *(getattr(reference, kind) for kind in beside)]
                )
        if table.rows:
            tables.append(table)
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
    notes = []
    factor = _values(figures, "", "real_time_factor")
    if factor is not None and np.any(np.isfinite(factor[0])):
        median, least = np.nanmedian(factor[0]), np.nanmin(factor[0])
        notes.append(f"Real-time factor: median {median:.2f}, least {least:.2f}.")
    memory = _values(figures, "", "peak_memory")
    if memory is not None and np.any(np.isfinite(memory[0])):
        notes.append(f"Peak memory of an episode: at most {np.nanmax(memory[0]) / 1e9:.2f} GB.")
    return notes


HOW_TO_READ = (
    "How to read a cell: median (5 % to 95 % of the episodes) of the magnitude, where what is"
    " missing counts as infinitely large ('none'); or mean ± standard deviation."
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
    metrics = {
        metric.name: metric for metric in (*EPISODE_METRICS, *application.metrics, *TICK_METRICS)
    }
    columns = application.overview
    table = Table(header=["experiment", *(column.header for column in columns), "paper", "goal"])
    flags: dict[int, list[Array]] = {}
    for name, frame in figures.items():
        experiment = application.experiments[name]
        missing = there[name] < wanted[name]
        cells = [f"{name}: {interrupted(there[name], wanted[name])}" if missing else name]
        for index, column in enumerate(columns):
            metric = metrics[column.metric]
            found = _values(frame, column.estimator, metric.name)
            if metric.totals:
                found = found or (np.full(frame["seed"].nunique(), np.nan), "")
                # Episodes that broke off count here too.
                known = np.where(np.isnan(found[0]) & _broke_off(frame), 0.0, found[0])
                flags.setdefault(index, []).append(known)
            shown = found is not None and len(found[0]) and metric.name not in experiment.without
            cells.append(metric.cell(*found) if shown and found and metric.cell else "-")
        beside = [_beside(application, experiment, kind) for kind in ("paper", "goal")]
        table.rows.append([*cells, *beside])
    ended, all_asked = sum(there.values()), sum(wanted.values())
    totals = [""] * len(columns)
    for index, values in flags.items():
        totals[index] = _total(np.concatenate(values), with_share=ended == all_asked)
    heading = "all" if ended == all_asked else f"all: {interrupted(ended, all_asked)}"
    table.rows.append([heading, *totals, "", ""])
    return table


def _broke_off(figures: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Of which of the episodes there is nothing of any estimator."""
    ended = figures.loc[figures["modality"] != "", "seed"].unique()
    return ~np.isin(figures["seed"].unique(), ended)


def _total(values: Array, *, with_share: bool) -> str:
    """'so many/of those that have a value (share, how many have none)'."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return "-"
    share = [f"{100.0 * np.mean(known == 1.0):.0f} %"] if with_share else []
    without = [f"{len(values) - len(known)} without"] if len(known) < len(values) else []
    beside = ", ".join(share + without)
    return count(known) + (f" ({beside})" if beside else "")


def _beside(application: Application, experiment: Experiment, kind: str) -> str:
    """What an experiment's errors are compared with, by 'paper' or 'goal'."""
    shown = dict.fromkeys(column.metric for column in application.overview)
    texts = [
        getattr(experiment.references[name], kind)
        for name in shown
        if name in experiment.references and not _is_count(application, name)
    ]
    return " / ".join(filter(None, texts)) or "-"


def _is_count(application: Application, name: str) -> bool:
    return any(
        metric.name == name and metric.totals for metric in (*EPISODE_METRICS, *application.metrics)
    )
