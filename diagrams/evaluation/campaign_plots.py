"""Draws what the episodes of an experiment have in common: over time, and at the end."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from diagrams.drawing import palette
from diagrams.drawing.plot_style import STYLE, mark_event, new_figure, note, shade
from diagrams.evaluation.metric_table import estimators_of, label, readable
from diagrams.run.application import Application
from diagrams.run.scenario import Disturbances
from maths.arrays import Array

BAND = (5.0, 95.0)  # Percentiles over the seeds.
_SMALLEST = 0.01  # Error that is still drawn, in the unit of its panel.


@dataclass(frozen=True, kw_only=True)
class Panel:
    """What is drawn over time in one panel.

    Attributes:
        title: With the unit.
        series: By estimator, of each episode that has one: times (T,) [s] and values (T,) in the
            panel's unit, NaN where there is none.
        logarithmic: Of errors; otherwise the values are shares of one.
    """

    title: str
    series: Mapping[str, Sequence[tuple[Array, Array]]]
    logarithmic: bool = True


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


def draw_spreads(
    application: Application,
    panels: Sequence[Panel],
    step: float,
    disturbances: Disturbances,
    events: Mapping[str, float],
) -> Figure:
    """Median and 5 to 95 % band over the seeds of each estimator, one panel below the other.

    Args:
        application: Whose estimators they are.
        panels: From top to bottom.
        step: Between two ticks, [s].
        disturbances: To be marked.
        events: Times to be marked, [s], by name.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 2.0 + 2.0 * len(panels))
        heights = [3, *[2] * (len(panels) - 1)]
        grid = figure.subplots(
            len(panels), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
        )[:, 0]
        for axes, panel in zip(grid, panels, strict=True):
            for index, (name, series) in enumerate(panel.series.items()):
                color = palette.estimator_color(application.colors, name, index)
                _draw_spread(axes, series, step, color, label(application, name))
            axes.set_title(panel.title)
            if panel.logarithmic:
                axes.set_yscale("log", nonpositive="clip")
                axes.set_ylim(bottom=max(_SMALLEST, axes.get_ylim()[0]))
            else:
                axes.set_ylim(-0.03, 1.05)
            _mark(axes, disturbances, events, label=axes is grid[0])
        grid[-1].set_xlabel("time [s]")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def _draw_spread(
    axes: Axes, series: Sequence[tuple[Array, Array]], step: float, color: str, label: str
) -> None:
    if not series:
        return
    times, (low, median, high) = spread(series, step)
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
            mark_event(axes, time)
            line = line + 1 if time - last < 0.1 * (right - left) else 1
            last = time
            if label:
                note(axes, time, name, lines_below=line)
    for name, interval in disturbances.spans():
        if interval.start >= right:
            continue
        shade(axes, interval.start, min(interval.end, right))
        if label:
            note(axes, interval.start, name)
    axes.set_xlim(left, right)


def draw_metrics(
    application: Application, figures: pd.DataFrame, titles: Mapping[str, str]
) -> Figure:
    """The magnitude of some metrics in every episode, by estimator.

    Args:
        application: Whose metrics they are.
        figures: The tidy table of the experiment.
        titles: What is drawn side by side, by the metric's name.
    """
    estimators = estimators_of(application, figures)
    with mpl.rc_context(STYLE):
        figure = new_figure(4.5 * len(titles), 1.9 + 0.5 * len(estimators))
        grid = figure.subplots(1, len(titles), squeeze=False)[0]
        for axes, (key, title) in zip(grid, titles.items(), strict=True):
            rows = figures[figures["metric"] == key]
            scale, unit = readable(str(rows["unit"].iloc[0])) if len(rows) else (1.0, "")
            for level, name in enumerate(estimators):
                values = scale * rows.loc[rows["modality"] == name, "value"].dropna().abs()
                if values.empty:
                    continue
                places = level + np.linspace(-0.22, 0.22, len(values))
                color = palette.estimator_color(application.colors, name, level)
                axes.scatter(values, places, s=26, color=color, alpha=0.75, lw=0)
                median = float(values.median())
                axes.plot([median, median], [level - 0.36, level + 0.36], color=color, lw=2.6)
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_yticks(range(len(estimators)), [label(application, n) for n in estimators])
            axes.set_ylim(len(estimators) - 0.45, -0.55)
            axes.set_title(f"{title} [{unit}]" if unit else title)
    return figure
