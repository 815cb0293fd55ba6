"""The figures of an experiment's episodes as a tidy table, and their summary in Markdown."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from diagrams.crossmodal.experiments import EXPERIMENTS, Experiment, Reference
from diagrams.drawing import palette
from maths.arrays import Array

Summary = dict[str, Any]
COLUMNS = ("experiment", "seed", "modality", "figure", "value", "unit", "reason")
# What figures are written in for people: factor and unit, by their unit in SI.
_READABLE = {
    "m": (1000.0, "mm"),
    "rad": (180.0 / math.pi, "deg"),
    "s": (1.0, "s"),
    "B": (1e-9, "GB"),
    "": (1.0, ""),
}


def tidy_figures(name: str, summaries: Sequence[Summary]) -> pd.DataFrame:
    """One row per episode, modality and figure.

    Columns: `experiment`, `seed`, `modality` (empty for figures of the whole episode), `figure`,
    `value` (SI and rad; 0 or 1 for what is false or true; NaN where there is no estimate), `unit`
    and `reason` (beside a `success` of 0, why). An episode that broke off has only the figures of
    the whole episode.
    """
    rows: list[dict[str, Any]] = []
    for summary in summaries:
        common = {"experiment": name, "seed": summary["seed"], "reason": ""}
        for figure, value, unit in _episode_figures(summary):
            rows.append(
                common | {"modality": "", "figure": figure, "value": _number(value), "unit": unit}
            )
            if figure == "success" and not value:
                rows[-1]["reason"] = summary.get("failure") or "unknown"
        for modality, record in summary.get("modalities", {}).items():
            rows += [
                common
                | {"modality": modality, "figure": figure, "value": _number(value), "unit": unit}
                for figure, value, unit in _modality_figures(record)
            ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _episode_figures(summary: Summary) -> list[tuple[str, Any, str]]:
    figures: list[tuple[str, Any, str]] = [("success", summary["success"], "")]
    unit = _configuration_unit(summary)
    for phase, record in summary.get("phases", {}).items():
        figures += [(f"{phase}_{key}", record[key], unit) for key in ("target", "reached", "error")]
    figures += [
        (key, summary[key], unit)
        for key, unit in (
            ("duration", "s"),
            ("wall_time", "s"),
            ("real_time_factor", ""),
            ("peak_memory", "B"),
        )
        if key in summary
    ]
    return figures


def _configuration_unit(summary: Summary) -> str:
    for record in summary.get("modalities", {}).values():
        return "rad" if record["joints"][0]["type_true"] == "revolute" else "m"
    return ""


def _modality_figures(record: Mapping[str, Any]) -> list[tuple[str, Any, str]]:
    joint = record["joints"][0]
    revolute = joint["type_true"] == "revolute"
    q = "rad" if revolute else "m"
    figures = [
        ("joint_found", joint["type_estimated"] in ("prismatic", "revolute"), ""),
        ("type_right", joint["type_estimated"] == joint["type_true"], ""),
        ("type_settled_at", joint["type_settled_at"], "s"),
        ("configuration_true", joint["configuration_true"], q),
        ("configuration_error", joint["configuration_error"], q),
        ("configuration_error_last_seen", joint["configuration_error_last_seen"], q),
        ("axis_angle_error", joint["axis_angle_error"], "rad"),
        ("consistency_configuration", joint["consistency"]["configuration"], ""),
        ("consistency_axis", joint["consistency"]["axis"], ""),
        ("tick_median", record["tick"]["median"], "s"),
        ("tick_p95", record["tick"]["p95"], "s"),
    ]
    if revolute:
        figures.append(("axis_distance_error", joint["axis_distance_error"], "m"))
    return figures


def quantile(values: npt.ArrayLike, share: float) -> float:
    """Quantile of magnitudes, linear between neighbours; NaN counts as infinitely large."""
    magnitudes = np.sort(np.where(np.isnan(np.asarray(values, float)), np.inf, np.abs(values)))
    place = share * (len(magnitudes) - 1)
    low, high = magnitudes[math.floor(place)], magnitudes[math.ceil(place)]
    fraction = place - math.floor(place)
    if fraction == 0.0 or low == high:
        return float(low)
    return float(low + fraction * (high - low))


def median_and_range(values: npt.ArrayLike, unit: str, digits: int = 1) -> str:
    """'median (5 % to 95 %) unit' of magnitudes in SI; 'none' for what is missing."""
    values = np.asarray(values, dtype=float)
    if not np.any(np.isfinite(values)):
        return "none"
    scale, readable = _READABLE[unit]

    def text(share: float) -> str:
        value = scale * quantile(values, share)
        return f"{value:.{digits}f}" if math.isfinite(value) else "none"

    return f"{text(0.5)} ({text(0.05)} to {text(0.95)}) {readable}".rstrip()


def mean_and_deviation(values: npt.ArrayLike, unit: str, digits: int = 1) -> str:
    """'mean ± standard deviation unit' of magnitudes in SI, of the episodes that have one."""
    values = np.asarray(values, dtype=float)
    known = np.abs(values[np.isfinite(values)])
    if len(known) == 0:
        return "-"
    scale, readable = _READABLE[unit]
    deviation = float(np.std(known, ddof=1)) if len(known) > 1 else math.nan
    text = f"{scale * np.mean(known):.{digits}f}"
    if math.isfinite(deviation):
        text += f" ± {scale * deviation:.{digits}f}"
    missing = len(values) - len(known)
    return f"{text} {readable}".rstrip() + (f" ({missing} without)" if missing else "")


def count(values: npt.ArrayLike) -> str:
    """'so many/of all'."""
    values = np.asarray(values, dtype=float)
    return f"{int(np.sum(values == 1.0))}/{len(values)}"


def mean_share(values: npt.ArrayLike) -> str:
    """Mean of shares in percent, of the episodes that have one."""
    values = np.asarray(values, dtype=float)
    known = values[np.isfinite(values)]
    return f"{100.0 * np.mean(known):.0f} %" if len(known) else "-"


@dataclass(kw_only=True)
class Row:
    """A row of the table.

    Attributes:
        title: What stands in its first cell; references name it.
        figure: Of the tidy table.
        cell: From one value per episode and their unit.
    """

    title: str
    figure: str
    cell: Callable[[Array, str], str]


def _milliseconds(values: Array, unit: str) -> str:
    known = values[np.isfinite(values)]
    return median_and_range(1000.0 * known, "", 1) + " ms" if len(known) else "-"


EPISODE_ROWS = (
    Row(title="task done", figure="success", cell=lambda v, _: count(v)),
    Row(title="exploration error", figure="exploration_error", cell=mean_and_deviation),
    Row(title="exploitation error", figure="exploitation_error", cell=mean_and_deviation),
)
MODALITY_ROWS = (
    Row(title="joint found", figure="joint_found", cell=lambda v, _: count(v)),
    Row(title="joint type right at the end", figure="type_right", cell=lambda v, _: count(v)),
    Row(
        title="configuration error at the end", figure="configuration_error", cell=median_and_range
    ),
    Row(
        title="configuration error when last seen",
        figure="configuration_error_last_seen",
        cell=median_and_range,
    ),
    Row(
        title="axis direction error",
        figure="axis_angle_error",
        cell=lambda v, unit: median_and_range(v, unit, 2),
    ),
    Row(title="axis distance error", figure="axis_distance_error", cell=median_and_range),
    Row(title="type settled after motion of", figure="type_settled_at", cell=median_and_range),
    Row(
        title="configuration's NEES inside 95 % bounds",
        figure="consistency_configuration",
        cell=lambda v, _: mean_share(v),
    ),
    Row(
        title="axis' NEES inside 95 % bounds",
        figure="consistency_axis",
        cell=lambda v, _: mean_share(v),
    ),
    Row(title="tick", figure="tick_median", cell=_milliseconds),
)
# Only where the object is brought to a target and back is the distance from it an error.
_TRIAL_FIGURES = ("exploration_error", "exploitation_error")
ROW_TITLES = tuple(row.title for row in (*EPISODE_ROWS, *MODALITY_ROWS))


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
    chosen = figures[(figures["figure"] == figure) & (figures["modality"] == modality)]
    if chosen.empty:
        return None
    by_seed = chosen.set_index("seed")["value"]
    return by_seed.reindex(figures["seed"].unique()).to_numpy(float), str(chosen["unit"].iloc[0])


def modalities_of(figures: pd.DataFrame) -> list[str]:
    """The modalities that there are, in the palette's order."""
    return [name for name in palette.MODALITY if name in set(figures["modality"])]


def _cells(figures: pd.DataFrame, row: Row, modalities: Sequence[str]) -> list[str] | None:
    found = [_values(figures, modality, row.figure) for modality in modalities]
    if all(values is None for values in found):
        return None
    return ["-" if values is None else row.cell(*values) for values in found]


def experiment_tables(experiment: Experiment, figures: pd.DataFrame) -> list[Table]:
    """The tables of the whole episodes and of the modalities, each beside paper and goal."""
    modalities = modalities_of(figures)
    labels = [palette.MODALITY_LABEL[name] for name in modalities]
    tables = []
    for rows, columns, header in (
        (EPISODE_ROWS, [""], ["all episodes"]),
        (MODALITY_ROWS, modalities, labels),
    ):
        table = Table(header=["", *header, "paper", "goal"])
        for row in rows:
            cells = _cells(figures, row, columns)
            if cells is not None and (experiment.returns or row.figure not in _TRIAL_FIGURES):
                beside = experiment.references.get(row.title, Reference())
                table.rows.append([row.title, *cells, beside.paper, beside.goal])
        if table.rows:
            tables.append(table)
    return tables


def failures_table(figures: pd.DataFrame) -> Table:
    """Seeds of the episodes that failed, and why."""
    failed = figures[(figures["figure"] == "success") & (figures["value"] == 0.0)]
    rows = [[str(seed), reason] for seed, reason in zip(failed.seed, failed.reason, strict=True)]
    return Table(header=["seed", "why the task was not done"], rows=rows)


def seed_ranges(seeds: Sequence[int]) -> str:
    """'100 to 119' for seeds in a row, else all of them."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def title(name: str, figures: pd.DataFrame) -> str:
    seeds = [int(seed) for seed in figures["seed"].unique()]
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
    "Errors by modality: median (5 % to 95 % of the episodes) of the magnitude, where an estimate"
    " that is missing counts as infinitely large ('none'). Exploration and exploitation: mean ±"
    " standard deviation of the distance from the target that was truly reached."
)


def markdown(name: str, experiment: Experiment, figures: pd.DataFrame, made_by: str) -> str:
    """An experiment's tables and its failures in Markdown.

    Args:
        made_by: How the figures were made: command, version and date.
    """
    parts = [f"# {title(name, figures)}", made_by]
    parts += [table.markdown() for table in experiment_tables(experiment, figures)]
    parts += [HOW_TO_READ, *running_notes(figures)]
    failures = failures_table(figures)
    if failures.rows:
        parts.append(failures.markdown())
    return "\n\n".join(filter(None, parts)) + "\n"


def overall_table(figures: Mapping[str, pd.DataFrame]) -> Table:
    """One row per experiment, by name, beside the paper's errors, and one of all of them."""
    rows = {row.figure: row for row in (*EPISODE_ROWS, *MODALITY_ROWS)}
    columns = (
        ("task done", "", "success"),
        ("type right, vision", "vision", "type_right"),
        ("type right, proprioception", "proprioception", "type_right"),
        ("type right, cross-modal", "crossmodal", "type_right"),
        ("error at the end, cross-modal", "crossmodal", "configuration_error"),
        ("exploration error", "", "exploration_error"),
        ("exploitation error", "", "exploitation_error"),
    )
    references = ("paper", "goal")
    table = Table(header=["experiment", *(header for header, _, _ in columns), *references])
    flags: dict[int, list[Array]] = {}
    for name, frame in figures.items():
        cells = [name]
        for index, (_, modality, key) in enumerate(columns):
            found = _values(frame, modality, key)
            if key in ("success", "type_right"):
                # Episodes that broke off count here too.
                found = found or (np.full(frame["seed"].nunique(), np.nan), "")
                flags.setdefault(index, []).append(found[0])
            if key in _TRIAL_FIGURES and not EXPERIMENTS[name].returns:
                found = None
            cells.append("-" if found is None else rows[key].cell(*found))
        table.rows.append([*cells, *(_error_reference(name, kind) for kind in references)])
    together = {index: np.concatenate(values) for index, values in flags.items()}
    totals = [
        f"{count(together[index])} ({100.0 * np.mean(together[index] == 1.0):.0f} %)"
        if index in together
        else ""
        for index in range(len(columns))
    ]
    table.rows.append(["all", *totals, *("" for _ in references)])
    return table


def _error_reference(name: str, kind: str) -> str:
    """What an experiment's errors are compared with, by 'paper' or 'goal'."""
    references = EXPERIMENTS[name].references
    titles = ("configuration error at the end", "exploration error", "exploitation error")
    texts = [getattr(references[title], kind) for title in titles if title in references]
    return " / ".join(filter(None, texts)) or "-"
