"""Draws what an episode comes to, view by view and touch by touch."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from crossmodal.diagrams.clutter.estimator_names import COLORS, LABELS
from crossmodal.diagrams.clutter.results.gains import Gain
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.maths.arrays import Array

Stages = Mapping[str, Sequence[Mapping[str, Any]]]
_MARKERS = {"guess": "D", "view": "o", "touch": "^"}
_EXPECTED = "#BBBBBB"


def draw_stages(stages: Stages, seed: int) -> Figure | None:
    """Translation error, with what is claimed of it, and ADI, as in the third paper's Fig. 6.

    None where the truth is not known.
    """
    if not _known(stages):
        return None
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 6.4)
        translation, adi = panels = figure.subplots(2, 1, sharex=True)
        for name, found in stages.items():
            at = np.array([stage["acquisitions"] for stage in found])
            color = COLORS.get(name, palette.QUIET)
            radius = _column(found, "translation_claimed")
            translation.plot(at, radius, color=color, lw=1.0, ls="--")
            translation.fill_between(at, 1e-3, radius, color=color, alpha=0.10, lw=0)
            for axes, key in ((translation, "translation_error"), (adi, "adi")):
                _draw_course(axes, at, _column(found, key), found, name)
        for axes in panels:
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
        _limit_to(translation, stages, ("translation_error", "translation_claimed"))
        _limit_to(adi, stages, ("adi",))
        translation.set_title(
            "translation error [mm] (dashed: radius that is claimed to hold it with 95 %)"
        )
        adi.set_title("ADI: mean distance between the true and the believed surface [mm]")
        _name_stages(adi, stages)
        translation.legend(handles=_handles(stages), loc="upper right", ncols=2)
        figure.suptitle(f"n = 1 episode, seed {seed}", fontsize=9.5)
    return figure


def draw_claim(stages: Stages, seed: int, bound: float) -> Figure | None:
    """Squared Mahalanobis distance of the true pose at each stage; None without the truth.

    Args:
        stages: Of each estimator.
        seed: Of the episode.
        bound: What it exceeds in 5 % of the cases, if the covariance is right.
    """
    if not _known(stages):
        return None
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.2)
        axes = figure.subplots()
        for name, found in stages.items():
            at = np.array([stage["acquisitions"] for stage in found])
            _draw_course(axes, at, _column(found, "distance", 1.0), found, name)
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        low = min(low, 1.0)
        axes.axhspan(low, bound, color="#000000", alpha=0.05, lw=0)
        axes.set_ylim(low, high)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.axhline(bound, color=palette.TRUTH, lw=1.0, ls="--")
        axes.axhline(6.0, color=palette.TRUTH, lw=0.8, ls=":")
        axes.set_title(
            "squared Mahalanobis distance of the true pose, 6 dof"
            f" (if the claim is right: 95 % below {bound:.1f}, mean 6)"
        )
        _name_stages(axes, stages)
        axes.legend(handles=_handles(stages), loc="best", ncols=2)
        figure.suptitle(f"n = 1 episode, seed {seed}", fontsize=9.5)
    return figure


def draw_gains(
    views: Sequence[Gain],
    touches: Sequence[Gain],
    outcomes: Mapping[int, Any],
    name: str,
    seed: int,
) -> Figure | None:
    """Expected and realised gain of each chosen view and touch; None where nothing was chosen.

    Args:
        views: [bit].
        touches: [m^2].
        outcomes: By the measurements' numbers.
        name: Of the estimator by which touches are chosen.
        seed: Of the episode.
    """
    drawn = [(kind, gains) for kind, gains in (("view", views), ("touch", touches)) if gains]
    if not drawn:
        return None
    color = COLORS.get(name, palette.QUIET)
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.2)
        widths = [len(gains) + 1.0 for _, gains in drawn]
        panels = figure.subplots(1, len(drawn), squeeze=False, width_ratios=widths)[0]
        for axes, (kind, gains) in zip(panels, drawn, strict=True):
            scale = 1e6 if kind == "touch" else 1.0
            bars = [
                ("expected", "expected", _EXPECTED),
                ("realised", "as the grid tells", "#4477AA")
                if kind == "view"
                else ("realised", f"as {LABELS.get(name, name)} tells", color),
            ]
            if kind == "touch" and any(np.isfinite(gain.true) for gain in gains):
                bars.append(("true", "true, of ADI²", palette.TRUTH))
            at = np.arange(len(gains))
            for index, (key, label, shade) in enumerate(bars):
                height = [scale * getattr(gain, key) for gain in gains]
                width = 0.8 / len(bars)
                left = at + width * (index - 0.5 * (len(bars) - 1))
                axes.bar(left, height, width, color=shade, label=label)
            axes.axhline(0.0, color=palette.TRUTH, lw=0.8)
            names = [_labelled(kind, gain.number, outcomes.get(gain.number)) for gain in gains]
            axes.set_xticks(at, names)
            axes.grid(visible=False, axis="x")
            axes.legend(loc="best")
            axes.set_title(
                "fall of the grid's entropy [bit]"
                if kind == "view"
                else "fall of the squared distance of surfaces [mm²]"
            )
            _compress(axes, gains, scale)
        figure.suptitle(f"n = 1 episode, seed {seed}", fontsize=9.5)
    return figure


def _compress(axes: Axes, gains: Sequence[Gain], scale: float) -> None:
    """A logarithmic axis, linear about zero: what is expected and what comes differ that much."""
    values = np.array([(gain.expected, gain.realised, gain.true) for gain in gains])
    sizes = scale * np.abs(values[np.isfinite(values) & (values != 0.0)])
    if len(sizes) and sizes.max() > 10.0 * sizes.min():
        axes.set_yscale("symlog", linthresh=max(sizes.min(), 1e-3 * sizes.max()))
        axes.yaxis.set_major_formatter("{x:g}")


def _labelled(kind: str, number: int, result: Any) -> str:
    if kind == "view":
        return f"view {number}\n{result} points"
    return f"touch {number}\n{result}"


def _known(stages: Stages) -> bool:
    return any(np.isfinite(stage["adi"]) for found in stages.values() for stage in found)


def _column(found: Sequence[Mapping[str, Any]], key: str, scale: float = 1e3) -> Array:
    return scale * np.array([stage[key] for stage in found], dtype=float)


def _draw_course(
    axes: Axes, at: Array, values: Array, found: Sequence[Mapping[str, Any]], name: str
) -> None:
    """One estimator's values (K,), with a marker by what was measured."""
    color = COLORS.get(name, palette.QUIET)
    axes.plot(at, values, color=color, lw=1.6)
    for kind, marker in _MARKERS.items():
        of_kind = np.array([stage["stage"] == kind for stage in found], dtype=bool)
        axes.plot(at[of_kind], values[of_kind], marker, color=color, mec="white", ms=8)


def _limit_to(axes: Axes, stages: Stages, keys: Sequence[str]) -> None:
    """Shows all values with these keys, [m], on a logarithmic axis in [mm]."""
    values = np.concatenate([_column(found, key) for found in stages.values() for key in keys])
    values = values[np.isfinite(values) & (values > 0.0)]
    axes.set_ylim(0.6 * values.min(), 1.7 * values.max())


def _name_stages(axes: Axes, stages: Stages) -> None:
    longest = max(stages.values(), key=len)
    names = [f"{stage['stage']} {stage['acquisitions'] or ''}".strip() for stage in longest]
    axes.set_xticks([stage["acquisitions"] for stage in longest], names)
    for label in axes.get_xticklabels():
        label.set(rotation=30, ha="right")


def _handles(stages: Stages) -> list[Line2D]:
    lines = [
        Line2D([], [], color=COLORS.get(name, palette.QUIET), lw=2, label=LABELS.get(name, name))
        for name in stages
    ]
    kinds = {stage["stage"] for found in stages.values() for stage in found}
    marks = [
        Line2D(
            [],
            [],
            color="#444444",
            marker=marker,
            ls="",
            ms=7,
            label=kind if kind == "guess" else f"after a {kind}",
        )
        for kind, marker in _MARKERS.items()
        if kind in kinds
    ]
    return lines + marks
