"""The table, the CSV file and the picture of an experiment's episodes."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from diagrams import palette
from diagrams.figures import save
from diagrams.run_folder import write_atomically, write_text

Summary = dict[str, Any]
RESULT_FILES = ("results.csv", "table.md", "errors.png")
_DEG = 180.0 / math.pi


def result_rows(summaries: list[Summary]) -> pd.DataFrame:
    """One row per seed and modality; an episode that broke off has one row with its reason."""
    rows: list[dict[str, Any]] = []
    for summary in summaries:
        phase = summary.get("phases", {}).get("exploration", {})
        common = {
            "seed": summary["seed"],
            "success": summary["success"],
            "failure": summary.get("failure"),
            "reached": phase.get("reached"),
            "real_time_factor": summary.get("real_time_factor"),
            "peak_memory": summary.get("peak_memory"),
        }
        if not summary.get("modalities"):
            rows.append(common)
        for name, modality in summary.get("modalities", {}).items():
            joint = dict(modality["joints"][0])
            consistency = joint.pop("consistency")
            flat = {key: value for key, value in joint.items() if not isinstance(value, list)}
            rows.append(
                common
                | {"modality": name}
                | flat
                | {"consistency_configuration": consistency["configuration"]}
                | {"consistency_axis": consistency["axis"]}
                | {"tick_median": modality["tick"]["median"], "tick_p95": modality["tick"]["p95"]}
            )
    return pd.DataFrame(rows)


def median_p90(values: npt.ArrayLike, scale: float, unit: str, digits: int) -> str:
    """'median (p90) unit'; what is missing counts as infinitely bad."""
    worst_first = np.asarray(
        [np.inf if value is None or pd.isna(value) else abs(value) for value in np.ravel(values)],
        dtype=float,
    )
    if len(worst_first) == 0:
        return "-"

    def text(share: float) -> str:
        value = scale * float(np.quantile(worst_first, share, method="higher"))
        return f"{value:.{digits}f}" if math.isfinite(value) else "none"

    return f"{text(0.5)} ({text(0.9)}) {unit}"


def table_rows(summaries: list[Summary]) -> tuple[list[str], list[list[str]]]:
    """Modalities and rows: title, then one cell per modality."""
    rows = result_rows(summaries)
    modalities = [name for name in palette.MODALITY if name in set(rows.get("modality", []))]
    groups = [rows[rows["modality"] == name] for name in modalities]
    episodes = len(summaries)
    broken = sum(not summary.get("modalities") for summary in summaries)

    def each(title: str, cell: Callable[[pd.DataFrame], str]) -> list[str]:
        return [title, *(cell(group) for group in groups)]

    def padded(group: pd.DataFrame, key: str) -> npt.NDArray[np.float64]:
        """Values of all episodes; those that broke off count as missing."""
        values = pd.to_numeric(group[key], errors="coerce").to_numpy(dtype=float)
        return np.concatenate([values, np.full(broken, np.nan)])

    def right(group: pd.DataFrame) -> str:
        return f"{int((group['type_estimated'] == group['type_true']).sum())}/{episodes}"

    def share(group: pd.DataFrame, key: str) -> str:
        values = pd.to_numeric(group[key], errors="coerce").dropna()
        return f"{100.0 * float(values.mean()):.0f} %" if len(values) else "-"

    scale, unit = (_DEG, "deg") if _is_revolute(rows) else (1000.0, "mm")
    done = f"{sum(bool(summary['success']) for summary in summaries)}/{episodes}"
    table = [
        ["task done", *([done] * len(groups))],
        each(
            "opening error at the end, median (p90)",
            lambda g: median_p90(padded(g, "configuration_error"), scale, unit, 1),
        ),
        each(
            "opening error when last seen, median (p90)",
            lambda g: median_p90(padded(g, "configuration_error_last_seen"), scale, unit, 1),
        ),
        each("joint type right at the end", right),
        each(
            "type settled after motion of, median (p90)",
            lambda g: median_p90(padded(g, "type_settled_at"), 1.0, "s", 1),
        ),
        each(
            "axis direction error, median (p90)",
            lambda g: median_p90(padded(g, "axis_angle_error"), _DEG, "deg", 2),
        ),
        each("opening's NEES inside 95 % bounds", lambda g: share(g, "consistency_configuration")),
        each("axis' NEES inside 95 % bounds", lambda g: share(g, "consistency_axis")),
        each("tick, median (p90)", lambda g: median_p90(g["tick_median"], 1000.0, "ms", 1)),
    ]
    if _is_revolute(rows):
        table.insert(
            6,
            each(
                "axis distance, median (p90)",
                lambda g: median_p90(padded(g, "axis_distance_error"), 1000.0, "mm", 1),
            ),
        )
    return modalities, table


def _is_revolute(rows: pd.DataFrame) -> bool:
    return "type_true" in rows and "revolute" in set(rows["type_true"].dropna())


def markdown(name: str, references: dict[str, str], summaries: list[Summary]) -> str:
    """The experiment's table and its failures in Markdown."""
    modalities, table = table_rows(summaries)
    seeds = [summary["seed"] for summary in summaries]
    labels = [palette.MODALITY_LABEL[modality] for modality in modalities]
    header = ["", *labels, "paper or peer"]
    lines = [f"# {name}: {len(summaries)} episodes, seeds {_ranges(seeds)}", ""]
    lines += [f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    for row in table:
        reference = references.get(row[0].partition(",")[0], "")
        lines.append(f"| {' | '.join([*row, reference])} |")
    factors = _numbers(summaries, "real_time_factor")
    memory = _numbers(summaries, "peak_memory")
    lines += ["", "An estimate that is missing counts as infinitely wrong ('none').", ""]
    if len(factors):
        lines.append(
            f"Real-time factor: median {np.median(factors):.2f}, least {min(factors):.2f}."
        )
    if len(memory):
        lines.append(f"Peak memory of an episode: at most {max(memory) / 1e9:.2f} GB.")
    failures = [summary for summary in summaries if not summary["success"]]
    if failures:
        lines += ["", "| seed | why the task was not done |", "|---|---|"]
        lines += [f"| {summary['seed']} | {summary.get('failure')} |" for summary in failures]
    return "\n".join(lines) + "\n"


def _numbers(summaries: list[Summary], key: str) -> list[float]:
    return [float(summary[key]) for summary in summaries if summary.get(key)]


def _ranges(seeds: list[int]) -> str:
    """'100 to 119' for seeds in a row, else all of them."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def draw_results(summaries: list[Summary]) -> Figure:
    """Every episode's final error of opening and axis, by modality."""
    rows = result_rows(summaries)
    scale, unit = (_DEG, "deg") if _is_revolute(rows) else (1000.0, "mm")
    modalities = [name for name in palette.MODALITY if name in set(rows.get("modality", []))]
    figure = Figure(figsize=(8.5, 3.2), layout="constrained")
    panels = figure.subplots(1, 2)
    quantities = (
        ("configuration_error", scale, f"opening error at the end [{unit}]"),
        ("axis_angle_error", _DEG, "axis direction error at the end [deg]"),
    )
    for axes, (key, factor, title) in zip(panels, quantities, strict=True):
        for level, name in enumerate(modalities):
            column = pd.to_numeric(rows.loc[rows["modality"] == name, key], errors="coerce")
            values = factor * column.dropna().abs().to_numpy()
            if len(values) == 0:
                continue
            spread = level + np.linspace(-0.22, 0.22, len(values))
            color = palette.MODALITY[name]
            axes.scatter(values, spread, s=26, color=color, alpha=0.75, lw=0)
            median = float(np.median(values))
            axes.plot([median, median], [level - 0.36, level + 0.36], color=color, lw=2.6)
        axes.set_xscale("log")
        axes.set_yticks(range(len(modalities)), [palette.MODALITY_LABEL[n] for n in modalities])
        axes.set_ylim(len(modalities) - 0.45, -0.55)
        axes.set_title(title, loc="left", fontsize=10)
        axes.grid(axis="x", color="#E6E6E6")
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def write_results(
    folder: Path, name: str, references: dict[str, str], summaries: list[Summary]
) -> list[Path]:
    """Writes the CSV file, the table and the picture; nothing where no episode has ended."""
    if not summaries:
        return []
    csv, table, picture = (folder / file for file in RESULT_FILES)
    rows = result_rows(summaries)
    return [
        write_atomically(csv, lambda path: rows.to_csv(path, index=False)),
        write_text(table, markdown(name, references, summaries)),
        write_atomically(picture, lambda path: save(draw_results(summaries), path)),
    ]
