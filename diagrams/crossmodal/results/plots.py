"""Draws an episode over time: errors of configuration and axis, and the configuration."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, mark_panels, new_figure
from crossmodal.diagrams.evaluation.metric_table import readable
from crossmodal.diagrams.joints.joint_metrics import (
    JointEpisode,
    JointSeries,
    drawn_in,
    last_seen,
    motion_start,
    unit_of,
)
from crossmodal.maths.arrays import Array


def _color(name: str) -> str:
    return palette.estimator_color(COLORS, name, 0)


def _line(name: str) -> dict[str, Any]:
    """The cross-modal curve is wide and lies below the others, so that none hides another."""
    return {"lw": 2.8, "zorder": 2.5} if name == "crossmodal" else {"lw": 1.5, "zorder": 3}


def draw_errors(episode: JointEpisode) -> Figure | None:
    """Error of the configuration and of the axis, and the belief in the true type, over time.

    None where the truth is not known.
    """
    truth = episode.truth
    if truth.joint_type is None:
        return None
    scale, unit = readable(unit_of(truth.joint_type))
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 8.0)
        configuration, axis, belief = panels = figure.subplots(
            3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 2, 2]}
        )
        all_series = _series(episode)
        lost: list[Line2D] = []
        for name, series in all_series.items():
            color, line = _color(name), _line(name)
            error, std = scale * series.error, scale * series.configuration_std
            configuration.plot(series.times, error, color=color, **line)
            configuration.fill_between(
                series.times, error - 2 * std, error + 2 * std, color=color, alpha=0.16, lw=0
            )
            degrees = np.rad2deg(series.axis_error)
            axis.plot(series.times, degrees, color=color, **line)
            axis.plot(series.times, np.rad2deg(series.axis_std), color=color, lw=1.0, ls=":")
            belief.plot(series.times, series.probability_true_type, color=color, **line)
            lost += _mark_loss(
                series, color, (configuration, error), (belief, series.probability_true_type)
            )
        configuration.axhline(0.0, color=palette.TRUTH, lw=0.9)
        configuration.set_title(f"configuration error [{unit}]: estimate minus truth")
        axis.set_title("axis direction error [deg] (dotted: the claimed deviation)")
        belief.set_title(f"probability of the true type ({truth.joint_type})")
        belief.set_ylim(-0.03, 1.05)
        belief.set_xlabel("time [s]")
        _limit_errors(configuration, axis, all_series, scale)
        beyond = _finish(panels, episode)
        _legend(figure, episode, [*lost[:1], *beyond])
    return figure


def draw_configurations(episode: JointEpisode) -> Figure | None:
    """The configuration as each modality believes it, and the true one; None without the truth."""
    truth = episode.truth
    if truth.joint_type is None:
        return None
    scale, unit = drawn_in(truth.joint_type)
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.4)
        axes = figure.subplots()
        for name, series in _series(episode).items():
            color = _color(name)
            # A type with another unit has no place on this axis.
            q = scale * np.where(np.isnan(series.error), np.nan, series.configuration)
            std = scale * series.configuration_std
            axes.fill_between(series.times, q - 2 * std, q + 2 * std, color=color, alpha=0.16, lw=0)
            axes.plot(series.times, q, color=color, **_line(name))
        true_q = scale * truth.opening()
        (true_line,) = axes.plot(
            truth.times, true_q, color=palette.TRUTH, lw=1.2, ls="--", zorder=4, label="truth"
        )
        axes.set_title(f"configuration [{unit}] of '{truth.name}'")
        axes.set_xlabel("time [s]")
        low, high = min(0.0, *true_q), max(0.0, *true_q)
        reach = max(high - low, 1e-3 * scale)
        axes.set_ylim(low - 0.15 * reach, high + 0.3 * reach)
        beyond = _finish([axes], episode)
        _legend(figure, episode, [true_line, *beyond])
    return figure


def _mark_loss(series: JointSeries, color: str, *curves: tuple[Axes, Array]) -> list[Line2D]:
    """A cross where a modality sees its joint for the last time before the episode's end.

    Returns:
        For the legend, a cross that says so.
    """
    last = last_seen(series)
    if last is None or last >= len(series.times) - 2:
        return []
    for axes, values in curves:
        axes.plot(series.times[last], values[last], "X", color=color, ms=8, mec="white", zorder=5)
    return [Line2D([], [], color=palette.QUIET, marker="X", ls="", ms=8, label="last seen")]


def _series(episode: JointEpisode) -> dict[str, JointSeries]:
    return {name: series for name, series in episode.series.items() if len(series.times)}


def _limit_errors(
    configuration: Axes, axis: Axes, all_series: dict[str, JointSeries], scale: float
) -> None:
    """Shows the bulk of the errors: a lost modality must not flatten the others."""
    right = [(s, s.type_is_right) for s in all_series.values()]
    errors = np.concatenate([np.zeros(1), *(s.error[ticks] for s, ticks in right)])
    angles = np.concatenate([np.zeros(1), *(s.axis_error[ticks] for s, ticks in right)])
    reach = scale * float(np.nanpercentile(np.abs(errors), 97)) * 1.6 + 1e-3
    configuration.set_ylim(-reach, reach)
    axis.set_ylim(0.0, max(1.0, 1.5 * float(np.rad2deg(np.nanpercentile(angles, 95)))))


def _finish(panels: Sequence[Axes], episode: JointEpisode) -> list[Line2D]:
    """Limits the time, marks curves that leave, events and disturbances; triangles for a legend."""
    start, duration = episode.truth.grasp_time, episode.record.duration
    begin = max(0.0, start - 1.0) if np.isfinite(start) and start < duration else 0.0
    panels[-1].set_xlim(begin, max(duration, begin + 1e-3))
    events = [(event.name, event.time) for event in episode.record.events]
    moving = motion_start(episode.truth)
    if moving is not None:
        events.append(("moving", moving))
    disturbances = episode.record.scenario.disturbances
    return mark_panels(panels, events, disturbances.spans())


def _legend(figure: Figure, episode: JointEpisode, others: Sequence[Line2D]) -> None:
    """The modalities, other lines, and what the band is."""
    modalities = [
        Line2D([], [], color=_color(name), lw=_line(name)["lw"] + 0.6, label=LABELS.get(name, name))
        for name in _series(episode)
    ]
    title = f"band: 2σ as claimed; n = 1 episode, seed {episode.record.scenario.seed}"
    handles = [*modalities, *others]
    figure.legend(handles=handles, loc="outside upper center", ncols=5, title=title)
