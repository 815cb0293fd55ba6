"""The picture of the declutter graph, read as XML."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from crossmodal.diagrams.clutter.results.graph_picture import ACTION_COLORS, graph_picture
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.declutter.segments import segment_of_contour
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_TRIES,
    DeclutterAction,
    DeclutterGraph,
    Segments,
)

SQUARE = [[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]]
PLACES = [(0.5, 0.0), (0.6, 0.0), (0.7, 0.05), (0.4, -0.05), (0.5, 0.4)]
NAMES = ["wineglass", "can", "box <1> & lid", "", "sponge"]
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def graph() -> DeclutterGraph:
    segments = []
    for number, (name, place) in enumerate(zip(NAMES, PLACES, strict=True)):
        flat = segment_of_contour(number, name, np.array(SQUARE) + np.array(place))
        segments.append(replace(flat, pixels=400.0 * flat.contour + 30.0))
    scene = Segments(number=1, segments=tuple(segments))
    return declutter_graph(scene, "wineglass", {3: 0.9}, NO_TRIES, DeclutterConfig())


def texts(root: ElementTree.Element) -> list[str]:
    return [item.text or "" for item in root.iter(f"{SVG}text")]


@pytest.mark.parametrize("size", [None, (640, 480)])
def test_it_names_all_objects(graph: DeclutterGraph, size: tuple[int, int] | None) -> None:
    root = ElementTree.fromstring(graph_picture(graph, size))
    found = texts(root)
    for number, name in enumerate(NAMES):
        assert str(number) in found
        assert (name or "unknown") in found
    weights = [f"{vertex.weight:.2f}" for vertex in graph.vertices[1:]]
    assert len(weights) == 3
    assert [text for text in found if text in weights] == weights


def test_it_says_what_is_next(graph: DeclutterGraph) -> None:
    root = ElementTree.fromstring(graph_picture(graph))
    vertex = graph.vertex(graph.next)
    words = f"next: {vertex.action} {vertex.segment.name or 'unknown'} {graph.next}"
    assert words in texts(root)
    dashed = [item for item in root.iter(f"{SVG}circle") if item.get("stroke-dasharray")]
    assert len(dashed) == 1


def test_a_push_is_drawn_with_its_finger(graph: DeclutterGraph) -> None:
    assert not graph.push.why
    root = ElementTree.fromstring(graph_picture(graph))
    assert len(list(root.iter(f"{SVG}polygon"))) == len(NAMES) + 1
    assert len(list(root.iter(f"{SVG}path"))) == 3 + 1


def test_actions_have_their_colours(graph: DeclutterGraph) -> None:
    root = ElementTree.fromstring(graph_picture(graph))
    fills = [item.get("fill") for item in root.iter(f"{SVG}circle") if item.get("fill") != "none"]
    assert fills.count(ACTION_COLORS[DeclutterAction.GRASP]) == 1
    assert fills.count(ACTION_COLORS[DeclutterAction.PUSH]) == 2


def test_vertices_stand_at_the_centroids_in_the_image(graph: DeclutterGraph) -> None:
    address = "data:image/png;base64,AAAA"
    root = ElementTree.fromstring(graph_picture(graph, (640, 480), address))
    places = {(item.get("cx"), item.get("cy")) for item in root.iter(f"{SVG}circle")}
    assert places == {(f"{400 * x + 30:.1f}", f"{400 * y + 30:.1f}") for x, y in PLACES}
    shown = root.find(f"{SVG}image")
    assert shown is not None
    assert (shown.get("href"), shown.get("width")) == (address, "640")


def test_without_a_graph_it_says_why() -> None:
    root = ElementTree.fromstring(graph_picture(NO_GRAPH))
    assert "there is no image yet" in texts(root)
