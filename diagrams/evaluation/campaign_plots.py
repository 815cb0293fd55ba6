"""Draws what the episodes of an experiment have in common: errors over time and at the end."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from diagrams.crossmodal.results.plots import STYLE, new_figure
from diagrams.crossmodal.scenario import Disturbances
from diagrams.drawing import palette
from diagrams.run.run_folder import ESTIMATES_FILE
from maths.arrays import Array

BAND = (5.0, 95.0)  # Percentiles over the seeds.
_SMALLEST = 0.01  # Error that is still drawn, [mm or deg].
_QUANTITIES = ("configuration", "axis", "type_probability")
_UNIT = {"prismatic": (1000.0, "mm"), "revolute": (180.0 / math.pi, "deg")}


@dataclass(kw_only=True)
class ErrorsOverTime:
    """One modality's errors in one episode; NaN where it has no estimate.

    Attributes:
        times: (T,), [s].
        joint_type: The true one.
        configuration: |estimate - truth| (T,), [m or rad]; only where the type is the true one or
            nothing has moved yet.
        axis: Angle to the true axis (T,), [rad].
        probability: Of the true type (T,).
    """

    times: Array
    joint_type: str
    configuration: Array
    axis: Array
    probability: Array


def errors_over_time(estimates: pd.DataFrame) -> dict[str, ErrorsOverTime]:
    """By modality, from an episode's table of estimates."""
    errors = {}
    known = estimates[estimates["quantity"].isin(_QUANTITIES)]
    for modality, rows in known.groupby("modality", observed=True):
        wide = rows.assign(key=rows["quantity"].astype(str) + "/" + rows["component"].astype(str))
        estimate = wide.pivot_table(index="time", columns="key", values="estimate", sort=True)
        truth = wide.pivot_table(index="time", columns="key", values="truth", sort=True)
        one = _errors(estimate, truth.reindex(estimate.index))
        if one is not None:
            errors[str(modality)] = one
    return errors


def _errors(estimate: pd.DataFrame, truth: pd.DataFrame) -> ErrorsOverTime | None:
    types = [str(key) for key in estimate if str(key).startswith("type_probability/")]
    true_type = next((key for key in types if (truth[key] == 1.0).any()), None)
    if true_type is None:
        return None
    likeliest = estimate[types].idxmax(axis=1)
    comparable = likeliest.isin([true_type, "type_probability/rigid"])

    def column(frame: pd.DataFrame, key: str) -> pd.Series:
        return frame[key] if key in frame else pd.Series(np.nan, index=estimate.index)

    difference = column(estimate, "configuration/") - column(truth, "configuration/")
    components = [f"axis/{name}" for name in "xyz"]
    axes, true_axes = (
        np.column_stack([column(frame, key).to_numpy(float) for key in components])
        for frame in (estimate, truth)
    )
    cross = np.linalg.norm(np.cross(axes, true_axes), axis=1)
    return ErrorsOverTime(
        times=estimate.index.to_numpy(float),
        joint_type=true_type.partition("/")[2],
        configuration=difference.abs().where(comparable).to_numpy(float),
        axis=np.arctan2(cross, np.abs(np.sum(axes * true_axes, axis=1))),
        probability=estimate[true_type].to_numpy(float),
    )


def read_errors(folders: Iterable[Path]) -> list[dict[str, ErrorsOverTime]]:
    """Of every episode among the folders that has its table of estimates."""
    columns = ["time", "modality", "quantity", "component", "estimate", "truth"]
    return [
        errors_over_time(pd.read_parquet(folder / ESTIMATES_FILE, columns=columns))
        for folder in folders
        if (folder / ESTIMATES_FILE).is_file()
    ]


def spread(series: Sequence[tuple[Array, Array]], step: float) -> tuple[Array, Array]:
    """Times (T,) and the quantiles (3, T) low, median, high over the episodes.

    An instant counts where at least half of the episodes have a value.

    Args:
        series: Times and values of each episode; NaN where there is none.
        step: Between the times, [s].
    """
    last = max((round(times[-1] / step) for times, _ in series if len(times)), default=-1)
    grid = np.full((len(series), last + 1), np.nan)
    for row, (times, values) in zip(grid, series, strict=True):
        row[np.round(times / step).astype(int)] = values
    kept = np.flatnonzero(2 * np.sum(np.isfinite(grid), axis=0) >= max(1, len(series)))
    if len(kept) == 0:
        return np.zeros(0), np.zeros((3, 0))
    low, high = BAND
    quantiles: Array = np.nanpercentile(grid[:, kept], [low, 50.0, high], axis=0)
    return np.asarray(kept * step, dtype=float), quantiles


def common_events(summaries: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Median time [s] of what the robot began in at least half of the episodes, by name."""
    times: dict[str, list[float]] = {}
    for summary in summaries:
        first = {event["name"]: event["time"] for event in reversed(summary.get("events", []))}
        for name, time in first.items():
            times.setdefault(name, []).append(time)
    return {
        name: float(np.median(found))
        for name, found in times.items()
        if 2 * len(found) >= len(summaries)
    }


def draw_errors_over_time(
    episodes: Sequence[Mapping[str, ErrorsOverTime]],
    step: float,
    disturbances: Disturbances,
    events: Mapping[str, float],
) -> Figure | None:
    """Median and 5 to 95 % band over the seeds of each modality's errors; None without episodes.

    Args:
        episodes: Errors by modality.
        step: Between two ticks, [s].
        disturbances: To be marked.
        events: Times to be marked, [s], by name.
    """
    known = [errors for episode in episodes for errors in episode.values()]
    if not known:
        return None
    scale, unit = _UNIT[known[0].joint_type]
    panels = (
        ("configuration", scale, f"configuration error [{unit}]"),
        ("axis", 180.0 / math.pi, "axis direction error [deg]"),
        ("probability", 1.0, f"probability of the true type ({known[0].joint_type})"),
    )
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 8.0)
        grid = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 2, 2]})
        for axes, (quantity, factor, name) in zip(grid, panels, strict=True):
            for modality, color in palette.MODALITY.items():
                series = [
                    (errors[modality].times, getattr(errors[modality], quantity))
                    for errors in episodes
                    if modality in errors
                ]
                _draw_spread(axes, series, step, factor, color, palette.MODALITY_LABEL[modality])
            axes.set_title(name)
            if quantity != "probability":
                axes.set_yscale("log", nonpositive="clip")
                axes.set_ylim(bottom=max(_SMALLEST, axes.get_ylim()[0]))
            _mark(axes, disturbances, events, label=axes is grid[0])
        grid[2].set_ylim(-0.03, 1.05)
        grid[2].set_xlabel("time [s]")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def _draw_spread(
    axes: Axes,
    series: Sequence[tuple[Array, Array]],
    step: float,
    factor: float,
    color: str,
    label: str,
) -> None:
    if not series:
        return
    times, quantiles = spread(series, step)
    low, median, high = factor * quantiles
    breaks = np.flatnonzero(np.diff(times) > 1.5 * step) + 1
    for part in np.split(np.arange(len(times)), breaks):
        axes.plot(times[part], median[part], color=color, lw=1.8, label=label)
        axes.fill_between(times[part], low[part], high[part], color=color, alpha=0.16, lw=0)
        label = "_"  # Once in the legend.


def _mark(
    axes: Axes, disturbances: Disturbances, events: Mapping[str, float], *, label: bool
) -> None:
    left, right = axes.get_xlim()
    line, last = 1, -np.inf
    for name, time in sorted(events.items(), key=lambda event: event[1]):
        if left <= time <= right:
            axes.axvline(time, color=palette.QUIET, lw=0.9, ls=(0, (4, 3)))
            line = line + 1 if time - last < 0.1 * (right - left) else 1
            last = time
            if label:
                _note(axes, time, name, lines_below=line)
    spans = [("lights off", interval) for interval in disturbances.lights_off]
    spans += [("camera covered", interval) for interval in disturbances.camera_covered]
    for name, interval in spans:
        if interval.start >= right:
            continue
        axes.axvspan(interval.start, min(interval.end, right), color="black", alpha=0.06, lw=0)
        axes.axvline(interval.start, color=palette.TRUTH, lw=1.1)
        if label:
            _note(axes, interval.start, name)
    axes.set_xlim(left, right)


def _note(axes: Axes, time: float, text: str, lines_below: int = 0) -> None:
    axes.annotate(
        text,
        (time, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3, -3 - 11 * lines_below),
        textcoords="offset points",
        va="top",
        fontsize=8.5,
    )


def draw_errors_at_end(figures: pd.DataFrame) -> Figure:
    """Every episode's final error of configuration and axis, by modality.

    Args:
        figures: The tidy table of the experiment.
    """
    panels = (
        ("configuration_error", "configuration error at the end"),
        ("axis_angle_error", "axis direction error at the end"),
    )
    modalities = [name for name in palette.MODALITY if name in set(figures["modality"])]
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 3.4)
        for axes, (key, title) in zip(figure.subplots(1, 2), panels, strict=True):
            rows = figures[figures["figure"] == key]
            metres = "m" in set(rows["unit"])
            scale, unit = _UNIT["prismatic" if metres else "revolute"]
            for level, name in enumerate(modalities):
                values = scale * rows.loc[rows["modality"] == name, "value"].dropna().abs()
                if values.empty:
                    continue
                places = level + np.linspace(-0.22, 0.22, len(values))
                color = palette.MODALITY[name]
                axes.scatter(values, places, s=26, color=color, alpha=0.75, lw=0)
                median = float(values.median())
                axes.plot([median, median], [level - 0.36, level + 0.36], color=color, lw=2.6)
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_yticks(range(len(modalities)), [palette.MODALITY_LABEL[n] for n in modalities])
            axes.set_ylim(len(modalities) - 0.45, -0.55)
            axes.set_title(f"{title} [{unit}]")
    return figure
