"""What the picture of the declutter graph shows."""

import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from crossmodal.diagrams.clutter.results.graph_picture import COLORS, TARGET, graph_picture
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_TRIES,
    DeclutterAction,
    DeclutterGraph,
    Segment,
    Segments,
)

PLACES = [(0.5, 0.0), (0.6, 0.0), (0.55, 0.07), (0.4, -0.05), (0.5, 0.4)]
NAMES = ["wineglass", "can", "box <1> & $lid$", "", "sponge"]
IMAGE = np.full((480, 640, 3), 200, np.uint8)


@pytest.fixture
def graph() -> DeclutterGraph:
    segments = []
    for number, (name, (x, y)) in enumerate(zip(NAMES, PLACES, strict=True)):
        contour = shapely.box(x - 0.02, y - 0.02, x + 0.02, y + 0.02)
        pixels = shapely.transform(contour, lambda p: 400.0 * p + 30.0)
        segments.append(Segment(number=number, name=name, contour=contour, pixels=pixels, top=0.05))
    scene = Segments(number=1, segments=tuple(segments))
    return declutter_graph(scene, "wineglass", {3: 0.9}, NO_TRIES, DeclutterConfig())


def drawn(figure: Figure) -> list[Text]:
    FigureCanvasAgg(figure).draw()
    return [*figure.axes[0].texts]


@pytest.mark.parametrize("image", [None, IMAGE], ids=["above", "image"])
def test_it_names_all_objects_and_weights(graph: DeclutterGraph, image: np.ndarray | None) -> None:
    found = [text.get_text() for text in drawn(graph_picture(graph, image))]
    for number, name in enumerate(NAMES):
        assert str(number) in found
        assert (name or "unknown") in found
    weights = [f"{vertex.weight:.2f}" for vertex in graph.vertices[1:]]
    assert len(weights) == 3
    assert [text for text in found if text in weights] == weights


def test_it_says_what_is_next(graph: DeclutterGraph) -> None:
    vertex = graph.vertex(graph.next)
    words = f"next: {vertex.action} {vertex.segment.name or 'unknown'} {graph.next}"
    assert graph_picture(graph).axes[0].get_title(loc="left") == words


def test_a_push_is_drawn_with_its_finger(graph: DeclutterGraph) -> None:
    assert graph.pushes
    axes = graph_picture(graph).axes[0]
    assert len(axes.patches) == len(NAMES) + 1
    assert len(axes.lines) == 3
    over = graph_picture(graph, IMAGE).axes[0]
    assert len(over.patches) == len(NAMES)


@pytest.mark.parametrize("image", [None, IMAGE], ids=["above", "image"])
def test_vertices_stand_at_the_centroids_in_the_colours_of_their_actions(
    graph: DeclutterGraph, image: np.ndarray | None
) -> None:
    vertices = {t.get_text(): t for t in drawn(graph_picture(graph, image)) if t.get_bbox_patch()}
    assert sorted(vertices) == ["0", "1", "2", "3", "4"]
    for number, place in enumerate(PLACES):
        text = vertices[str(number)]
        expected = place if image is None else 400.0 * np.array(place) + 30.0
        np.testing.assert_allclose(text.get_position(), expected)
        box = text.get_bbox_patch()
        assert box is not None
        action = None if number == 4 else graph.vertex(number).action
        color = TARGET if number == 0 else COLORS[action]
        assert to_hex(box.get_facecolor()).upper() == color
    assert graph.vertex(3).action is DeclutterAction.GRASP


def test_without_a_graph_it_says_why() -> None:
    figure = graph_picture(NO_GRAPH)
    assert drawn(figure) == []
    assert figure.axes[0].get_title(loc="left") == "there is no image yet"
