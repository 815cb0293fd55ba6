"""How every plot looks, and how it is written."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from diagrams.drawing import palette

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


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as PNG, whatever the file's name ends with."""
    FigureCanvasAgg(figure)
    figure.savefig(path, format="png", dpi=130, facecolor="white")


def new_figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def note(axes: Axes, time: float, text: str, *, side: str = "left", lines_below: int = 0) -> None:
    """Writes what happens at `time` at the top of a plot over time."""
    axes.annotate(
        text,
        (time, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3 if side == "left" else -1, -3 - 11 * lines_below),
        textcoords="offset points",
        va="top",
        ha=side,
        fontsize=8.5,
        color="#444444",
    )


def mark_event(axes: Axes, time: float) -> None:
    """A dashed line where something begins."""
    axes.axvline(time, color=palette.QUIET, lw=0.9, ls=(0, (4, 3)))


def shade(axes: Axes, start: float, end: float) -> None:
    """A shade over a time in which the cameras see less."""
    axes.axvspan(start, end, color="#000000", alpha=0.06, lw=0)
    axes.axvline(start, color=palette.TRUTH, lw=1.1)
