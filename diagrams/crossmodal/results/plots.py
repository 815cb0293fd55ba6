"""Draws an episode over time: errors of opening and axis, and the opening against the truth."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from diagrams.crossmodal.modalities import COLORS, LABELS
from diagrams.crossmodal.task import later_events
from diagrams.drawing import palette
from diagrams.drawing.plot_style import STYLE, mark_event, new_figure, note, shade
from diagrams.joints.joint_episode import JointEpisode
from diagrams.joints.joint_metrics import JointSeries, last_seen, motion_start
from maths.arrays import Array
from systems.port_values import JointType

_UNIT = {JointType.PRISMATIC: (1000.0, "mm"), JointType.REVOLUTE: (180.0 / np.pi, "deg")}
# The cross-modal curve is wide and lies below the others, so that none hides another.
_LINE: dict[str, Any] = {
    "vision": {"lw": 1.5, "zorder": 3},
    "proprioception": {"lw": 1.5, "zorder": 3},
    "crossmodal": {"lw": 2.8, "zorder": 2.5},
}


def _color(name: str) -> str:
    return palette.estimator_color(COLORS, name, 0)


def _line(name: str) -> dict[str, Any]:
    return _LINE.get(name, {"lw": 1.5, "zorder": 3})


def draw_errors(episode: JointEpisode) -> Figure | None:
    """Error of the opening and of the axis, and the belief in the true type, over time.

    None where the truth is not known.
    """
    truth = episode.truth
    if truth.joint_type is None:
        return None
    scale, unit = _UNIT[truth.joint_type]
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 8.0)
        opening, axis, belief = figure.subplots(
            3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 2, 2]}
        )
        all_series = _series(episode)
        for name, series in all_series.items():
            color, line = _color(name), _line(name)
            error, std = scale * series.error, scale * series.configuration_std
            opening.plot(series.times, error, color=color, **line)
            opening.fill_between(
                series.times, error - 2 * std, error + 2 * std, color=color, alpha=0.16, lw=0
            )
            degrees = np.rad2deg(series.axis_error)
            axis.plot(series.times, degrees, color=color, **line)
            axis.plot(series.times, np.rad2deg(series.axis_std), color=color, lw=1.0, ls=":")
            belief.plot(series.times, series.probability_true_type, color=color, **line)
            _mark_loss(series, color, (opening, error), (belief, series.probability_true_type))
        opening.axhline(0.0, color=palette.TRUTH, lw=0.9)
        opening.set_title("opening: estimate minus truth, with its 2σ band")
        opening.set_ylabel(f"error [{unit}]")
        axis.set_title("joint axis: angle to the true one (dotted: what the filter expects)")
        axis.set_ylabel("angle [deg]")
        belief.set_title(f"probability of the true joint type ({truth.joint_type})")
        belief.set_ylim(-0.03, 1.05)
        belief.set_xlabel("time [s]")
        _limit_errors(opening, axis, all_series, scale)
        for axes in (opening, axis, belief):
            _mark_events(axes, episode, label=axes is opening)
        _limit_time(belief, episode)
        _legend(figure, list(all_series), with_truth=False)
    return figure


def draw_configurations(episode: JointEpisode) -> Figure | None:
    """The opening as each modality believes it, against the truth; None where that is not known."""
    truth = episode.truth
    if truth.joint_type is None:
        return None
    scale, unit = (100.0, "cm") if truth.joint_type == JointType.PRISMATIC else (180 / np.pi, "deg")
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.2)
        axes = figure.subplots()
        for name, series in (all_series := _series(episode)).items():
            color = _color(name)
            # A type with another unit has no place on this axis.
            q = scale * np.where(np.isnan(series.error), np.nan, series.configuration)
            std = scale * series.configuration_std
            axes.fill_between(series.times, q - 2 * std, q + 2 * std, color=color, alpha=0.16, lw=0)
            axes.plot(series.times, q, color=color, **_line(name))
        axes.plot(
            truth.times, scale * truth.opening(), color=palette.TRUTH, lw=1.2, ls="--", zorder=4
        )
        axes.set_title(f"{truth.joint_name}: estimated opening with its 2σ band")
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"opening [{unit}]")
        top = scale * float(np.max(np.abs(truth.opening()), initial=1e-3))
        axes.set_ylim(-0.15 * top, 1.3 * top)
        _mark_events(axes, episode, label=True)
        _limit_time(axes, episode)
        _legend(figure, list(all_series), with_truth=True)
    return figure


def _mark_loss(series: JointSeries, color: str, *curves: tuple[Axes, Array]) -> None:
    """A cross where a modality sees its joint for the last time before the episode's end."""
    last = last_seen(series)
    if last is None or last >= len(series.times) - 2:
        return
    for axes, values in curves:
        axes.plot(series.times[last], values[last], "X", color=color, ms=8, mec="white", zorder=5)


def _series(episode: JointEpisode) -> dict[str, JointSeries]:
    return {name: series for name, series in episode.series.items() if len(series.times)}


def _limit_errors(
    opening: Axes, axis: Axes, all_series: dict[str, JointSeries], scale: float
) -> None:
    """Shows the bulk of the errors: a lost modality must not flatten the others."""
    right = [(s, s.type_is_right) for s in all_series.values()]
    errors = np.concatenate([np.zeros(1), *(s.error[ticks] for s, ticks in right)])
    angles = np.concatenate([np.zeros(1), *(s.axis_error[ticks] for s, ticks in right)])
    reach = scale * float(np.nanpercentile(np.abs(errors), 97)) * 1.6 + 1e-3
    opening.set_ylim(-reach, reach)
    axis.set_ylim(0.0, max(1.0, 1.5 * float(np.rad2deg(np.nanpercentile(angles, 95)))))


def _limit_time(axes: Axes, episode: JointEpisode) -> None:
    start = episode.truth.grasp_time
    begin = max(0.0, start - 1.0) if np.isfinite(start) and start < episode.record.duration else 0.0
    axes.set_xlim(begin, max(episode.record.duration, begin + 1e-3))


def _mark_events(axes: Axes, episode: JointEpisode, *, label: bool) -> None:
    """Vertical lines where something happens, shades where the camera sees less."""
    disturbances = episode.record.scenario.disturbances
    # The first two lie close together: their names stand on either side.
    events = [
        ("grasped ", episode.truth.grasp_time, "right"),
        ("moving", motion_start(episode.truth), "left"),
        *((event.name, event.time, "left") for event in later_events(episode.record.events)),
    ]
    for name, time, side in events:
        if time is not None and np.isfinite(time) and time < episode.record.duration:
            mark_event(axes, time)
            if label:
                note(axes, time, name, side=side)
    duration = episode.record.duration
    for name, interval in disturbances.spans():
        if interval.start < duration:
            shade(axes, interval.start, min(interval.end, duration))
            if label:
                note(axes, interval.start, name)


def _legend(figure: Figure, modalities: list[str], *, with_truth: bool) -> None:
    handles = [
        Line2D(
            [],
            [],
            color=_color(name),
            lw=_line(name)["lw"] + 0.6,
            label=LABELS.get(name, name),
        )
        for name in modalities
    ]
    if with_truth:
        handles.append(Line2D([], [], color=palette.TRUTH, lw=1.2, ls="--", label="truth"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
