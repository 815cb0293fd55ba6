"""Draws the hand's force along the joint over the way, with friction and end stops as believed."""

import math

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, drawn_in, unit_of
from crossmodal.diagrams.joints.mechanics_record import (
    CLAIMED,
    TickMechanics,
    mechanics_at,
    true_range,
)
from crossmodal.systems.port_values import LimitBelief


def draw_mechanics(episode: JointEpisode) -> Figure | None:
    """Force against configuration; None where no modality measured forces.

    The band is friction at the mean speed, two claimed deviations wide; a thick upright line an end
    stop that was reached; a dotted one how far the joint went where none was.
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
                _draw(axes, palette.estimator_color(COLORS, name, 0), ticks, scale)
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


def _draw(axes: Axes, color: str, ticks: list[TickMechanics], scale: float) -> None:
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


def _handle(name: str) -> Line2D:
    color = palette.estimator_color(COLORS, name, 0)
    return Line2D([], [], color=color, lw=2.0, label=LABELS.get(name, name))
