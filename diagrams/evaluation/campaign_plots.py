"""Draws what the episodes of an experiment have in common: over time, and at the end."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, TIME, mark_panels, new_figure
from crossmodal.diagrams.evaluation.metric_table import estimators_of, label, quantile, readable
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.scenario import Disturbances
from crossmodal.maths.arrays import Array

BAND = (5.0, 95.0)  # Percentiles over the seeds.
_SMALLEST = 0.01  # Error that is still drawn, in the unit of its panel.
_HOW_TO_READ = (
    f"line: median; band: {BAND[0]:.0f} to {BAND[1]:.0f} % of the n episodes;"
    " an ended one keeps its last value, a missing error counts as infinite"
)


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


def spread(
    series: Sequence[tuple[Array, Array]], step: float, missing: float = np.inf
) -> tuple[Array, Array]:
    """Times (T,) and the quantiles (3, T) low, median, high over all episodes, at every instant.

    An episode that has ended keeps its last value, so that no curve jumps because the set of
    episodes has changed, and the curves end at the figures of the tables.

    Args:
        series: Times and values of each episode; NaN where there is none.
        step: Between the times, [s].
        missing: What counts where there is no value; a quantile may be infinite.
    """
    last = max((round(times[-1] / step) for times, _ in series if len(times)), default=-1)
    grid = np.full((len(series), last + 1), np.nan)
    for row, (times, values) in zip(grid, series, strict=True):
        places = np.round(times / step).astype(int)
        row[places] = values
        if len(places):
            row[places[-1] :] = values[-1]
    grid[np.isnan(grid)] = missing
    if grid.size == 0:
        return np.zeros(0), np.zeros((3, 0))
    low, high = BAND
    shares = (low / 100.0, 0.5, high / 100.0)
    return step * np.arange(last + 1), np.stack([quantile(grid, share) for share in shares])


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
    """Median and 5 to 95 % band over the episodes of each estimator, one panel below the other.

    What is missing counts as infinitely large in a logarithmic panel, and as zero in another.

    Args:
        application: Whose estimators they are.
        panels: From top to bottom.
        step: Between two ticks, [s].
        disturbances: To be marked.
        events: Times to be marked, [s], by name.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 2.2 + 2.0 * len(panels))
        heights = [3, *[2] * (len(panels) - 1)]
        grid = figure.subplots(
            len(panels), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
        )[:, 0]
        every = [times for panel in panels for one in panel.series.values() for times, _ in one]
        grid[0].set_xlim(0.0, max([step, *(times[-1] for times in every if len(times))]))
        for axes, panel in zip(grid, panels, strict=True):
            axes.set_title(panel.title)
            axes.set_yscale("log" if panel.logarithmic else "linear")
            _draw_panel(axes, application, panel, step)
        beyond = mark_panels(list(grid), list(events.items()), disturbances.spans())
        grid[-1].set_xlabel(TIME)
        handles = [*grid[0].get_legend_handles_labels()[0], *beyond]
        figure.legend(handles=handles, loc="outside upper center", ncols=4, title=_HOW_TO_READ)
    return figure


def _draw_panel(axes: Axes, application: Application, panel: Panel, step: float) -> None:
    missing = np.inf if panel.logarithmic else 0.0
    top = 0.0
    for index, (name, series) in enumerate(panel.series.items()):
        if not series:
            continue
        times, (low, median, high) = spread(series, step, missing)
        color = palette.estimator_color(application.colors, name, index)
        text = f"{label(application, name)} (n = {len(series)})"
        axes.plot(times, median, color=color, lw=1.8, label=text)
        # An infinite end of the band is beyond every axis; an infinite begin leaves it out.
        ends = np.minimum(high, np.finfo(np.float32).max)
        begins = np.where(np.isfinite(low), low, np.nan)
        axes.fill_between(times, begins, ends, color=color, alpha=0.16, lw=0)
        known = np.concatenate([median, high])
        top = max(top, *known[np.isfinite(known)], 0.0)
    if not panel.logarithmic:
        axes.set_ylim(-0.03, 1.05)
    elif top > 0.0:
        drawn = np.concatenate([np.asarray(line.get_ydata(), float) for line in axes.lines])
        positive = drawn[np.isfinite(drawn) & (drawn > 0.0)]
        bottom = float(positive.min()) if len(positive) else _SMALLEST
        axes.set_ylim(max(_SMALLEST, 0.5 * bottom), 1.5 * max(top, 2.0 * _SMALLEST))


def draw_metrics(
    application: Application, figures: pd.DataFrame, titles: Mapping[str, str]
) -> Figure:
    """The magnitude of some metrics in every episode, by estimator.

    Args:
        application: Whose metrics they are.
        figures: The tidy table of the experiment.
        titles: What is drawn side by side, by the metric's name.
    """
    estimators, seeds = estimators_of(application, figures), figures["seed"].unique()
    with mpl.rc_context(STYLE):
        figure = new_figure(4.5 * len(titles), 2.2 + 0.5 * len(estimators))
        grid = figure.subplots(1, len(titles), squeeze=False)[0]
        for axes, (key, title) in zip(grid, titles.items(), strict=True):
            rows = figures[figures["metric"] == key]
            scale, unit = readable(str(rows["unit"].iloc[0])) if len(rows) else (1.0, "")
            names = []
            for level, name in enumerate(estimators):
                values = rows.loc[rows["modality"] == name].set_index("seed")["value"]
                values = scale * values.reindex(seeds).abs()
                median, known = float(quantile(values, 0.5)), values.dropna()
                of_all = f" of {len(seeds)}" if len(known) < len(seeds) else ""
                names.append(f"{label(application, name)}\n(n = {len(known)}{of_all})")
                places = level + np.linspace(-0.22, 0.22, len(known))
                color = palette.estimator_color(application.colors, name, level)
                if len(known):
                    axes.scatter(known, places, s=26, color=color, alpha=0.75, lw=0)
                if math.isfinite(median):
                    axes.plot([median, median], [level - 0.36, level + 0.36], color=color, lw=2.6)
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_yticks(range(len(estimators)), names)
            axes.set_ylim(len(estimators) - 0.45, -0.55)
            axes.set_title(f"{title} [{unit}]" if unit else title)
        dot = Line2D([], [], color=palette.QUIET, marker="o", ls="", label="an episode")
        bar = Line2D([], [], color=palette.QUIET, marker="|", ls="", ms=14, mew=2.6)
        bar.set_label("median; a missing error counts as infinite")
        figure.legend(handles=[dot, bar], loc="outside lower center", ncols=2)
    return figure
