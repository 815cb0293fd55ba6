"""Boxes around objects, free places, and a guess of where an object is."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from numpy.testing import assert_allclose
from shapely import affinity

from crossmodal.systems.declutter.around import (
    AroundConfig,
    boxes_around,
    free_places,
    guess_of,
)
from crossmodal.systems.port_values import Segment, of_middle
from crossmodal.systems.pose.target_model import make_target
from tests.systems.declutter.scenes import random_scene, rectangle

CONFIG = AroundConfig()
EDGES = np.array([0.06, 0.06, 0.2])
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


@pytest.mark.parametrize("angle", [0.0, 0.7, -1.2])
def test_a_box_holds_its_object_and_no_more(angle: float) -> None:
    segment = replace(rectangle(1, "can", (0.5, 0.1), (0.2, 0.06), angle), top=np.nan)
    ((edges, X_WB),) = boxes_around([segment], 0.01, replace(CONFIG, slab=1.0))
    assert_allclose(sorted(edges), [0.06, 0.2, CONFIG.unknown_top], atol=1e-12)
    assert_allclose(X_WB[:3, 3], [0.5, 0.1, 0.01 + 0.5 * CONFIG.unknown_top], atol=1e-12)
    assert_allclose(X_WB[:3, :3] @ X_WB[:3, :3].T, np.eye(3), atol=1e-12)
    corners = shapely.get_coordinates(segment.contour)[:4] - X_WB[:2, 3]
    inside = np.abs(corners @ X_WB[:2, :2])
    assert_allclose(inside, np.tile(0.5 * edges[:2], (4, 1)), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_boxes_along_an_object_hold_all_of_it_and_are_smaller_than_one(seed: int) -> None:
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    wedge = shapely.Polygon([(0.0, -0.05), (0.2, -0.01), (0.2, 0.01), (0.0, 0.05)])
    segment = Segment(number=0, contour=affinity.rotate(wedge, angle, use_radians=True))
    boxes = boxes_around([segment], 0.0, CONFIG)
    assert len(boxes) == 4
    shapes = [
        shapely.Polygon(
            X_WB[:2, 3] + 0.5 * edges[:2] * [[a, b] for a, b in CORNERS] @ X_WB[:2, :2].T
        )
        for edges, X_WB in boxes
    ]
    union = shapely.union_all(shapes).buffer(1e-9)
    assert union.contains(segment.contour)
    assert union.area < 0.7 * segment.box.area + 1e-6 < segment.box.area


def test_a_known_height_is_that_of_the_box() -> None:
    segment = Segment(number=0, contour=shapely.box(0.0, 0.0, 0.1, 0.1), top=0.07)
    for edges, X_WB in boxes_around([segment], 0.0, CONFIG):
        assert_allclose([edges[2], X_WB[2, 3]], [0.07, 0.035])


@pytest.mark.parametrize("seed", range(5))
def test_what_is_put_down_turned_in_any_way_keeps_its_distance(seed: int) -> None:
    target, *others = random_scene(seed)
    moved, *rest = others
    places = free_places(moved, [target, *rest], target, CONFIG)
    assert len(places) > 0
    outline = shapely.get_coordinates(moved.contour) - moved.centroid
    for place in places[:: max(len(places) // 20, 1)]:
        for angle in np.linspace(0.0, np.pi, 7):
            c, s = np.cos(angle), np.sin(angle)
            there = shapely.Polygon(outline @ [[c, s], [-s, c]] + place)
            assert there.distance(target.contour) > CONFIG.near
            assert min(there.distance(other.contour) for other in rest) > CONFIG.margin


def test_on_a_full_table_there_is_no_place() -> None:
    target = rectangle(0, "can", (0.5, 0.0), (0.4, 0.7))
    assert free_places(rectangle(1, "can", (0.9, 0.0)), [target], target, CONFIG).shape == (0, 2)


def test_the_guess_is_about_the_middle() -> None:
    mesh = trimesh.creation.box(extents=EDGES)
    mesh.apply_translation([0.3, 0.2, 0.1])  # The mesh's frame is not its middle.
    model = make_target(mesh.vertices, mesh.faces)
    segment = Segment(number=0, contour=shapely.box(0.47, 0.07, 0.53, 0.13), top=0.2)
    guess = guess_of(segment, model.middle, EDGES, 0.0, CONFIG)
    assert_allclose(of_middle(guess.X, model.middle)[:3, 3], [0.5, 0.1, 0.1], atol=1e-6)
    assert guess.rotation_sigma == np.inf
    assert guess.translation_sigma == CONFIG.middle_error  # All of its length was seen.
    half = Segment(number=0, contour=shapely.box(0.47, 0.07, 0.53, 0.13), top=0.05)
    assert guess_of(half, model.middle, EDGES, 0.0, CONFIG).translation_sigma > 0.04
    glass = replace(segment, is_glass=True)
    guess = guess_of(glass, model.middle, EDGES, 0.0, CONFIG)  # It stands or lies.
    z, sigma = of_middle(guess.X, model.middle)[2, 3], guess.translation_sigma
    assert z - 1.5 * sigma < 0.03
    assert z + 1.5 * sigma > 0.1
