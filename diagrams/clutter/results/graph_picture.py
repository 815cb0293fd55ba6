"""The declutter graph as a picture."""

from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from crossmodal.diagrams.clutter.action_colors import COLORS, TARGET
from crossmodal.diagrams.drawing.palette import QUIET, TRUTH
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.systems.port_values import DeclutterAction, DeclutterGraph


def graph_picture(graph: DeclutterGraph, image: npt.NDArray[np.uint8] | None = None) -> Figure:
    """A graph over an image, or seen from above with W's x to the right and y up.

    A vertex stands at the centroid of its object and has its number; the colour is that of its
    action. The object to take away next has a dashed edge. Numbers at edges are weights. A push is
    drawn from above only, with the finger's place.

    Args:
        graph: To draw.
        image: (H, W, 3); objects that have no outline in it are left out. None: from above.
    """
    colors = {v.segment.number: COLORS[v.action] for v in graph.vertices}
    colors |= {v.segment.number: TARGET for v in graph.vertices[:1]}
    segments = [*(v.segment for v in graph.vertices), *graph.apart]
    shapes = {s.number: s.contour if image is None else s.pixels for s in segments}
    places = {n: shape.centroid.coords[0] for n, shape in shapes.items() if not shape.is_empty}
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = new_figure(7.0, 6.0)
        axes = figure.add_subplot(aspect="equal", xlabel="x in W [m]", ylabel="y in W [m]")
        axes.set_title(_summary(graph))
        if image is not None:
            axes.imshow(image)
            axes.axis("off")
        for number in places:
            _draw(axes, shapes[number], colors.get(number, QUIET), 0.2)
        for v in graph.vertices[1:]:
            if {v.parent, v.segment.number} <= places.keys():
                ends = np.array([places[v.parent], places[v.segment.number]])
                axes.plot(*ends.T, color=colors[v.segment.number], lw=2.0)
                _write(axes, tuple(ends.mean(axis=0)), f"{v.weight:.2f}", 4.0)
        if image is None and graph.pushes:
            push, color = graph.pushes[0], COLORS[DeclutterAction.PUSH]
            _draw(axes, push.finger, TRUTH, 0.5)
            way = push.length * push.direction
            axes.quiver(*push.point, *way, color=color, units="xy", scale_units="xy", scale=1.0)
            axes.update_datalim([push.point + way])
        for segment in segments:
            if segment.number in places:
                number, (x, y) = segment.number, places[segment.number]
                edge = TRUTH if number == graph.next else "none"
                box: dict[str, Any] = {
                    "boxstyle": "circle",
                    "fc": colors.get(number, QUIET),
                    "ec": edge,
                }
                box |= {"ls": "--", "lw": 2.0}
                axes.text(x, y, f"{number}", color="white", ha="center", va="center", bbox=box)
                _write(axes, (x, y), segment.name or "unknown", -24.0)
        names = [("target", TARGET), *((f"{a}", c) for a, c in COLORS.items() if a is not None)]
        marks = [Line2D([], [], color=c, marker="o", ls="", label=name) for name, c in names]
        figure.legend(handles=marks, loc="outside lower center", ncols=len(marks))
    return figure


def _draw(axes: Axes, shape: shapely.Geometry, color: str, alpha: float) -> None:
    for part in shapely.get_parts(shape):
        axes.fill(*part.exterior.xy, fc=(color, alpha), ec=color)


def _write(axes: Axes, place: tuple[float, float], words: str, above: float) -> None:
    """Words so many points above a place, with a white edge, so that all can be read."""
    edge = [withStroke(linewidth=3, foreground="white")]
    text = axes.annotate(words, place, (0.0, above), textcoords="offset points", ha="center")
    text.set(color=TRUTH, path_effects=edge, parse_math=False)


def _summary(graph: DeclutterGraph) -> str:
    if graph.next < 0:
        return graph.why
    vertex = graph.vertex(graph.next)
    return f"next: {vertex.action} {vertex.segment.name or 'unknown'} {graph.next}"
