"""The declutter graph as a picture in SVG."""

from collections.abc import Iterator
from html import escape

import numpy as np

from crossmodal.diagrams.drawing.palette import QUIET, TRUTH
from crossmodal.maths.arrays import Array
from crossmodal.maths.polygons import centroid
from crossmodal.systems.port_values import DeclutterAction, DeclutterGraph, Segment

ACTION_COLORS = {DeclutterAction.GRASP: "#228833", DeclutterAction.PUSH: "#EE7733"}
_TARGET = "#AA3377"
_SCALE = 1500.0  # Of a drawing on the table's plane, [px/m].
_AROUND = 60.0  # Free space around such a drawing, [px].
_LINE = 26.0  # Height of a line of text, [px].
_RADIUS = 13.0  # Of a vertex, [px].


def graph_picture(
    graph: DeclutterGraph, image_size: tuple[int, int] | None = None, image: str = ""
) -> str:
    """A graph as SVG, over an image or seen from above with W's x to the right and y up.

    A vertex stands at the centroid of its object and has its number; the colour is that of its
    action. The target has a double ring, the object to take away next a dashed one. Numbers at
    edges are weights. A push is drawn from above only, with the finger's place.

    Args:
        graph: To draw.
        image_size: Width and height of the image, [px]; objects that have no outline in it are
            left out. None: from above.
        image: Address of the image, for example `data:image/png;base64,...`; empty for none.
    """
    actions = {v.segment.number: v.action for v in graph.vertices}
    segments = [*(v.segment for v in graph.vertices), *graph.apart]
    root = graph.vertices[0].segment.number if graph.vertices else -1
    if image_size is None:
        corners = np.concatenate([s.contour for s in segments] or [np.zeros((1, 2))])
        low, high = corners.min(axis=0), corners.max(axis=0)
        width, height = _SCALE * (high - low) + 2.0 * _AROUND
        outlines = {s.number: _from_above(s.contour, low, high) for s in segments}
    else:
        width, height = image_size
        outlines = {s.number: s.pixels for s in segments if len(s.pixels)}
    places = {number: centroid(outline) for number, outline in outlines.items()}
    canvas = max(width, 480.0)  # The text below needs so much.
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" font-family="Helvetica, Arial, sans-serif"'
        f' font-size="14" width="{canvas:.0f}" height="{height + 2 * _LINE:.0f}">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    if image and image_size is not None:
        lines.append(f'<image href="{escape(image)}" width="{width:.0f}" height="{height:.0f}"/>')
    for number, outline in outlines.items():
        color = _color(number, root, actions.get(number))
        lines.append(
            f'<polygon points="{_points(outline)}" fill="{color}" fill-opacity="0.18"'
            f' stroke="{color}" stroke-width="1.5"/>'
        )
    for v in graph.vertices[1:]:
        if v.segment.number in places and v.parent in places:
            start, end = places[v.parent], places[v.segment.number]
            color = _color(v.segment.number, root, v.action)
            lines.append(f'<path d="M {_points(np.array([start, end]))}" {_stroke(color, 3.0)}/>')
            x, y = 0.5 * (start + end)
            lines.append(_text(x, y - 5.0, f"{v.weight:.2f}", TRUTH))
    if image_size is None and not graph.push.why:
        lines += _drawn_push(graph, low, high)
    for segment in segments:
        if segment.number in places:
            lines += _drawn_vertex(segment, places[segment.number], graph, root, actions)
    for line, words in enumerate([_summary(graph), "magenta: target, green: grasp, orange: push"]):
        lines.append(_text(0.5 * canvas, height + (line + 0.7) * _LINE, words, TRUTH))
    return "\n".join([*lines, "</svg>", ""])


def _from_above(points: Array, low: Array, high: Array) -> Array:
    """Places in the drawing (N, 2), [px], of places in W (N, 2), [m]."""
    x, y = points.T
    return _AROUND + _SCALE * np.column_stack([x - low[0], high[1] - y])


def _color(number: int, root: int, action: DeclutterAction | None) -> str:
    if number == root:
        return _TARGET
    return QUIET if action is None else ACTION_COLORS[action]


def _points(points: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _stroke(color: str, width: float) -> str:
    return f'fill="none" stroke="{color}" stroke-width="{width:g}"'


def _text(x: float, y: float, words: str, color: str) -> str:
    """Words about a place, with a white edge, so that they can be read on anything."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" fill="{color}"'
        f' stroke="white" stroke-width="4" paint-order="stroke">{escape(words)}</text>'
    )


def _drawn_push(graph: DeclutterGraph, low: Array, high: Array) -> Iterator[str]:
    push = graph.push
    color = ACTION_COLORS[DeclutterAction.PUSH]
    finger = _from_above(push.finger, low, high)
    yield f'<polygon points="{_points(finger)}" fill="{TRUTH}" fill-opacity="0.5"/>'
    end = push.point + push.length * push.direction
    left = np.array([-push.direction[1], push.direction[0]])
    barbs = [end - 0.01 * push.direction + side * 0.006 * left for side in (1.0, -1.0)]
    way = np.array([push.point, end, barbs[0], end, barbs[1]])
    dashes = f'{_stroke(color, 4.0)} stroke-linejoin="round"'
    yield f'<path d="M {_points(_from_above(way, low, high))}" {dashes}/>'


def _drawn_vertex(
    segment: Segment,
    place: Array,
    graph: DeclutterGraph,
    root: int,
    actions: dict[int, DeclutterAction | None],
) -> Iterator[str]:
    number = segment.number
    x, y = place
    circle = f'<circle cx="{x:.1f}" cy="{y:.1f}" r='
    color = _color(number, root, actions.get(number))
    yield f'{circle}"{_RADIUS}" fill="{color}"/>'
    if number == root:
        yield f'{circle}"{_RADIUS + 4.0}" {_stroke(color, 2.0)}/>'
    if number == graph.next:
        yield f'{circle}"{_RADIUS + 5.0}" {_stroke(TRUTH, 3.0)} stroke-dasharray="6 4"/>'
    yield f'<text x="{x:.1f}" y="{y + 5.0:.1f}" text-anchor="middle" fill="white">{number}</text>'
    yield _text(x, y + _RADIUS + 19.0, segment.name or "unknown", TRUTH)


def _summary(graph: DeclutterGraph) -> str:
    if graph.next < 0:
        return graph.why
    vertex = graph.vertex(graph.next)
    return f"next: {vertex.action} {vertex.segment.name or 'unknown'} {graph.next}"
