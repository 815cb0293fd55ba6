"""How every plot looks, and how it is written."""

import json
import math
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from crossmodal.diagrams.drawing import palette
from crossmodal.maths.arrays import Array, Mask

STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.edgecolor": "#666666",
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
}
TIME = "time [s]"  # The label below a plot over time.
_PANELS = "Panels over time"  # Key of a PNG's text.


class Panel(NamedTuple):
    """Where a panel over time is in a picture: edges as shares of it, and its ends in time [s]."""

    left: float
    right: float
    top: float
    bottom: float
    first: float
    last: float


def save(figure: Figure, file: Path | IO[bytes]) -> None:
    """Writes a figure as PNG, whatever the file's name ends with.

    The file says where in it time runs, so that `read_panels` finds a time's place.
    """
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()  # Lays it out.
    text = {_PANELS: json.dumps(panels_over_time(figure))}
    figure.savefig(file, format="png", dpi=130, facecolor="white", metadata=text)


def panels_over_time(figure: Figure) -> list[Panel]:
    """The panels of a figure that was laid out whose axis, or one that they share, is time."""
    found: list[Panel] = []
    for axes in figure.axes:
        siblings = axes.get_shared_x_axes().get_siblings(axes)
        if any(one.get_xlabel() == TIME for one in siblings):
            box, (first, last) = axes.get_position(), axes.get_xlim()
            found.append(Panel(box.x0, box.x1, 1.0 - box.y1, 1.0 - box.y0, first, last))
    return found


def read_panels(png: Path) -> list[Panel] | None:
    """What `panels_over_time` found in the figure of a PNG; None where the file does not say.

    Raises:
        OSError, ValueError, SyntaxError: where it is no PNG.
    """
    with Image.open(png, formats=["PNG"]) as image:
        image.load()
        text = getattr(image, "text", {}).get(_PANELS)
    try:
        panels = [Panel(*map(float, panel)) for panel in json.loads(text or "null")]
    except (TypeError, ValueError):
        return None
    return panels if all(map(math.isfinite, chain.from_iterable(panels))) else None


def new_figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def note(axes: Axes, time: float, text: str, *, lines_below: int = 0) -> None:
    """Writes what happens at `time` at the top of a plot over time."""
    axes.annotate(
        text,
        (time, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3, -3 - 11 * lines_below),
        textcoords="offset points",
        va="top",
        fontsize=8.5,
        color="#444444",
    )


def mark_times(
    axes: Axes,
    events: Iterable[tuple[str, float]],
    spans: Iterable[tuple[str, Any]],
    *,
    label: bool,
) -> None:
    """Dashed lines where something begins, shades over times in which the cameras see less.

    Args:
        axes: Over time, within its final limits.
        events: Names and times [s].
        spans: Names and, with `start` and `end` [s], times.
        label: Whether the names are written there.
    """
    left, right = axes.get_xlim()
    line, last = 0, -np.inf
    for name, time in sorted(events, key=lambda event: event[1]):
        if left <= time <= right:
            axes.axvline(time, color=palette.QUIET, lw=0.9, ls=(0, (4, 3)))
            line = line + 1 if time - last < 0.1 * (right - left) else 0
            last = time
            if label:
                note(axes, time, name, lines_below=line + 1)
    for name, span in spans:
        if span.start < right:
            axes.axvspan(span.start, min(span.end, right), color="#000000", alpha=0.06, lw=0)
            axes.axvline(span.start, color=palette.TRUTH, lw=1.1)
            if label:
                note(axes, span.start, name)
    axes.set_xlim(left, right)


def mark_panels(
    panels: Sequence[Axes],
    events: Sequence[tuple[str, float]],
    spans: Sequence[tuple[str, Any]],
) -> list[Line2D]:
    """Marks in panels over one time, within their final limits, what happens and curves that leave.

    Returns:
        For the legend, see `mark_leaving`.
    """
    beyond: dict[object, Line2D] = {}
    for axes in panels:
        beyond |= {entry.get_label(): entry for entry in mark_leaving(axes)}
        mark_times(axes, events, spans, label=axes is panels[0])
    return list(beyond.values())


def mark_leaving(axes: Axes) -> list[Line2D]:
    """Triangles on the frame where a curve leaves it, upwards or downwards, and where it returns.

    A curve that begins infinite has not left: there is nothing of it yet. A dotted curve has hollow
    ones.

    Args:
        axes: With its curves, within its final limits.

    Returns:
        For the legend, a triangle of each kind that there is and what it means.
    """
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    entries = {}
    for curve in [line for line in axes.lines if line.get_transform() is axes.transData]:
        times, values = (np.asarray(data, dtype=float) for data in curve.get_data())
        color, solid = curve.get_color(), curve.get_linestyle() != ":"
        shown = (left <= times) & (times <= right) & np.logical_or.accumulate(np.isfinite(values))
        for beyond, edge, marker in ((values > high, 1.0, "^"), (values < low, 0.0, "v")):
            found = _ends(times, beyond & shown, 0.015 * (right - left))
            if not found:
                continue
            axes.plot(
                found,
                np.full(len(found), edge),
                marker,
                transform=axes.get_xaxis_transform(),
                clip_on=False,
                zorder=6,
                in_layout=False,
                **_triangle(color, solid),
            )
            entries[solid] = Line2D(
                [],
                [],
                marker="^",
                ls="",
                label="beyond the frame" if solid else "dotted curve beyond the frame",
                **_triangle(palette.QUIET, solid),
            )
    axes.set_xlim(left, right)
    return list(entries.values())


def _triangle(color: Any, solid: bool) -> dict[str, Any]:
    if solid:
        return {"mfc": color, "mec": "white", "ms": 8}
    return {"mfc": "white", "mec": color, "ms": 6}


def _ends(times: Array, beyond: Mask, apart: float) -> list[float]:
    """Where the stretches `beyond` begin and end, (T,); of those closer than `apart` the first."""
    steps = np.diff(np.concatenate([[0], beyond.astype(int), [0]]))
    kept: list[float] = []
    for time in np.sort(times[np.r_[np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1]]):
        if not kept or time - kept[-1] > apart:
            kept.append(float(time))
    return kept
