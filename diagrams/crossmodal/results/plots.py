"""Draws an episode: errors and the configuration over time, the joint's forces over its way."""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, TIME, mark_panels, new_figure
from crossmodal.diagrams.evaluation.metric_table import readable
from crossmodal.diagrams.joints.joint_metrics import (
    JointEpisode,
    JointSeries,
    drawn_in,
    drawn_std,
    last_seen,
    motion_start,
    unit_of,
)
from crossmodal.diagrams.joints.mechanics_record import (
    CLAIMED,
    TickMechanics,
    mechanics_at,
    true_range,
)
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import LimitBelief


def _color(name: str) -> str:
    return palette.estimator_color(COLORS, name, 0)


def _handle(name: str, width: float = 2.0) -> Line2D:
    return Line2D([], [], color=_color(name), lw=width, label=LABELS.get(name, name))


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
            error, std = scale * series.error, scale * drawn_std(series, truth)
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
        axis.set_title("axis direction error [deg] (dotted: the reported deviation)")
        belief.set_title(f"probability of the true type ({truth.joint_type})")
        belief.set_ylim(-0.03, 1.05)
        belief.set_xlabel(TIME)
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
            std = scale * drawn_std(series, truth)
            axes.fill_between(series.times, q - 2 * std, q + 2 * std, color=color, alpha=0.16, lw=0)
            axes.plot(series.times, q, color=color, **_line(name))
        true_q = scale * truth.opening()
        (true_line,) = axes.plot(
            truth.times, true_q, color=palette.TRUTH, lw=1.2, ls="--", zorder=4, label="truth"
        )
        axes.set_title(f"configuration [{unit}] of '{truth.name}'")
        axes.set_xlabel(TIME)
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
    modalities = [_handle(name, _line(name)["lw"] + 0.6) for name in _series(episode)]
    title = "band: 2σ as reported; where a rigid joint is claimed, of all types with this unit"
    title += f"\nn = 1 episode, seed {episode.record.scenario.seed}"
    handles = [*modalities, *others]
    figure.legend(handles=handles, loc="outside upper center", ncols=5, title=title)


def draw_mechanics(episode: JointEpisode) -> Figure | None:
    """Force against configuration; None where no modality measured forces.

    The band is friction at the mean speed, two reported deviations wide; a thick upright line an
    end stop that was reached; a dotted one how far the joint went where none was.
    """
    found = {name: ticks for name in episode.series if (ticks := _felt(episode, name))}
    if not found:
        return None
    kinds = [ticks[-1].joint_type for ticks in found.values()]
    kind = next((k for k in kinds if k == episode.truth.joint_type), kinds[0])
    scale, unit = drawn_in(kind)
    force_unit = "N" if unit_of(kind) == "m" else "N m"
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.8)
        axes = figure.subplots()
        for name, ticks in found.items():
            if unit_of(ticks[-1].joint_type) == unit_of(kind):
                _draw_forces(axes, _color(name), ticks, scale)
        truth = episode.truth
        handles: list[Artist] = [_handle(name) for name in found]
        mechanics = truth.mechanics
        if truth.joint_type == kind and math.isfinite(mechanics.friction):
            speed = found[next(iter(found))][-1].belief.mean_speed
            resistance = mechanics.friction + mechanics.damping * np.nan_to_num(speed)
            axes.axhline(resistance, color=palette.TRUTH, lw=1.2, ls="--", zorder=4)
            low, high = axes.get_xlim()
            for end in true_range(truth):
                if low - 0.15 * (high - low) <= scale * end <= high + 0.15 * (high - low):
                    axes.axvline(scale * end, color=palette.TRUTH, lw=1.2, ls="--", zorder=4)
            handles.append(Line2D([], [], color=palette.TRUTH, lw=1.2, ls="--", label="truth"))
        axes.set_xlabel(f"configuration [{unit}]")
        axes.set_title(f"force of the hand along the joint [{force_unit}]")
        handles += [
            Patch(color=palette.QUIET, alpha=0.3, label="friction, 2σ"),
            Line2D([], [], color=palette.QUIET, lw=3.0, label="end stop reached"),
            Line2D([], [], color=palette.QUIET, lw=1.2, ls=":", label="went so far"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=6)
    return figure


def _felt(episode: JointEpisode, name: str) -> list[TickMechanics]:
    series, ticks = episode.series[name], episode.record.estimators[name].ticks
    every = (mechanics_at(tick, series, k, episode.truth) for k, tick in enumerate(ticks))
    return [tick for tick in every if tick is not None]


def _draw_forces(axes: Axes, color: str, ticks: list[TickMechanics], scale: float) -> None:
    last = ticks[-1]
    same = [tick for tick in ticks if tick.joint_type == last.joint_type]
    q = scale * np.array([tick.configuration for tick in same])
    axes.plot(q, [tick.force for tick in same], color=color, lw=1.2, zorder=3)
    if last.belief.samples:
        value, std = last.resistance
        ways = {float(np.sign(tick.force)) for tick in same if abs(tick.force) > 0.5 * value}
        for way in ways:
            low, high = way * value - 2.0 * std, way * value + 2.0 * std
            axes.fill_between([q.min(), q.max()], low, high, color=color, alpha=0.16, lw=0)
    for limit in (last.lower, last.upper):
        _draw_limit(axes, color, limit, scale)


def _draw_limit(axes: Axes, color: str, limit: LimitBelief, scale: float) -> None:
    if limit.probability > CLAIMED:
        std = scale * math.sqrt(limit.variance)
        at = scale * limit.position
        axes.axvline(at, color=color, lw=3.0, alpha=0.8)
        axes.axvspan(at - 2.0 * std, at + 2.0 * std, color=color, alpha=0.16, lw=0)
    else:
        axes.axvline(scale * limit.bound, color=color, lw=1.2, ls=":")
