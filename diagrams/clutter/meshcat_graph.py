"""Draws the declutter graph over its objects into Meshcat."""

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform

from crossmodal.diagrams.clutter.action_colors import COLORS, TARGET
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.legend import Entry
from crossmodal.diagrams.drawing.meshcat import Shown, frame_along
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import (
    NO_GRAPH,
    DeclutterAction,
    DeclutterGraph,
    DeclutterVertex,
    Segment,
)

_ABOVE = 0.06  # Of the vertices above their objects, [m].
_UNKNOWN_TOP = 0.1  # Of an object of which none was measured, [m].
_RADIUS, _NEXT_RADIUS, _EDGE = 0.012, 0.02, 0.004  # [m]

GRAPH_LEGEND: list[Entry] = [
    ("dot", TARGET, "the object that is sought, in the declutter graph"),
    ("dot", COLORS[DeclutterAction.GRASP], "one that is to be grasped; large: the next one"),
    ("dot", COLORS[DeclutterAction.PUSH], "one that is to be pushed; large: the next one"),
    ("dot", COLORS[None], "one that cannot be moved"),
]


class GraphLayer:
    """The last graph: a ball above each object and a rod along each edge.

    Args:
        meshcat: The page.
        path: Below which it is drawn.
    """

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat, self._path, self._graph = meshcat, path, NO_GRAPH
        self._shown = Shown(meshcat)

    def draw(self, time: float, graph: DeclutterGraph, over: bool) -> None:
        """Draws what is new; `over`: nothing more is taken away."""
        if over:
            self._shown.hide(time)
            return
        if graph.number <= self._graph.number:
            return
        self._graph = graph
        path = f"{self._path}/{graph.number}"
        for vertex in graph.vertices:
            self._draw_vertex(path, vertex, graph)
        self._shown.show(path, time)

    def _draw_vertex(self, path: str, vertex: DeclutterVertex, graph: DeclutterGraph) -> None:
        number, at = vertex.segment.number, _place(vertex.segment)
        color = Rgba(*palette.rgb(TARGET if vertex.parent < 0 else COLORS[vertex.action]))
        ball = f"{path}/{number}/ball"
        radius = _NEXT_RADIUS if number == graph.next else _RADIUS
        self._meshcat.SetObject(ball, Sphere(radius), color)
        self._meshcat.SetTransform(ball, RigidTransform(at))
        if vertex.parent < 0:
            return
        way = _place(graph.vertex(vertex.parent).segment) - at
        length = float(np.linalg.norm(way))
        if length > 0.0:
            rod = f"{path}/{number}/edge"
            self._meshcat.SetObject(rod, Cylinder(_EDGE, length), color)
            X = RigidTransform(frame_along(way / length), at + 0.5 * way)
            self._meshcat.SetTransform(rod, X)


def _place(segment: Segment) -> Array:
    """Of a vertex (3,) in W, [m]; the table's top is about z = 0."""
    top = segment.top if np.isfinite(segment.top) else _UNKNOWN_TOP
    return np.append(segment.centroid, top + _ABOVE)
