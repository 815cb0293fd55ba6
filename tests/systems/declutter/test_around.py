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
    bodies_around,
    free_places,
    guess_of,
    passed_heights,
)
from crossmodal.systems.port_values import Bodies, Segment, of_middle
from crossmodal.systems.pose.target_model import make_target
from tests.systems.declutter.scenes import random_scene, rectangle

CONFIG = AroundConfig()
EDGES = np.array([0.06, 0.06, 0.2])
ABOVE = np.array([0.5, 0.1, 0.7])


def bases(bodies: Bodies) -> list[shapely.Geometry]:
    return [shapely.MultiPoint(vertices[:, :2]).convex_hull for vertices in bodies]


@pytest.mark.parametrize("angle", [0.0, 0.7, -1.2])
def test_a_body_holds_its_object_and_no_more(angle: float) -> None:
    segment = replace(rectangle(1, "can", (0.5, 0.1), (0.2, 0.06), angle), top=np.nan)
    bodies = bodies_around([segment], 0.01, replace(CONFIG, slab=1.0))
    (base,) = bases(bodies)
    assert base.symmetric_difference(segment.contour).area < 1e-12
    assert_allclose(np.unique(bodies[0][:, 2]), [0.01, 0.01 + CONFIG.unknown_top])


@pytest.mark.parametrize("seed", range(3))
def test_bodies_along_an_object_hold_all_of_it_and_little_more(seed: int) -> None:
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    corner = shapely.Polygon(
        [(0.0, 0.0), (0.2, 0.0), (0.2, 0.04), (0.06, 0.04), (0.06, 0.15), (0.0, 0.15)]
    )
    segment = Segment(number=0, contour=affinity.rotate(corner, angle, use_radians=True))
    union = shapely.union_all(bases(bodies_around([segment], 0.0, CONFIG)))
    assert union.buffer(1e-9).contains(segment.contour)
    assert union.area < 1.2 * segment.contour.area < 0.9 * segment.contour.convex_hull.area


def test_a_known_height_is_that_of_the_body() -> None:
    segment = Segment(number=0, contour=shapely.box(0.0, 0.0, 0.1, 0.1), top=0.07)
    for vertices in bodies_around([segment], 0.0, CONFIG):
        assert_allclose(np.unique(vertices[:, 2]), [0.0, 0.07])


def test_a_grain_has_a_body_with_a_volume() -> None:
    segment = Segment(number=0, contour=shapely.box(0.0, 0.0, 1e-4, 1e-4), top=0.07)
    (base,) = bases(bodies_around([segment], 0.0, CONFIG))
    assert base.area > 1e-5


def test_what_lies_on_the_way_is_passed_over_and_what_lies_beside_is_not() -> None:
    own = rectangle(0, "can", (0.4, 0.0), (0.06, 0.06))
    beside = replace(rectangle(1, "oil", (0.4, 0.06), (0.06, 0.06)), top=0.3)
    ahead = replace(rectangle(2, "box", (0.55, 0.0), (0.04, 0.04)), top=0.12)
    places = np.array([[0.4, -0.3], [0.7, 0.0], [0.4, 0.3], [0.5, 0.0]])
    found = passed_heights(own, [beside, ahead], places, CONFIG)
    assert_allclose(found, [0.0, 0.12, 0.3, 0.0])


@pytest.mark.parametrize("seed", range(5))
def test_what_is_put_down_keeps_its_distance(seed: int) -> None:
    target, *others = random_scene(seed)
    moved, *rest = others
    places = free_places(moved, [target, *rest], target, CONFIG)
    assert len(places) > 0
    outline = shapely.get_coordinates(moved.contour) - moved.centroid
    for place in places[:: max(len(places) // 20, 1)]:
        there = shapely.Polygon(outline + place).convex_hull
        assert there.distance(target.contour) > CONFIG.near + 2.0 * CONFIG.margin
        assert min(there.distance(other.contour) for other in rest) > CONFIG.margin


def test_on_a_full_table_there_is_no_place() -> None:
    target = rectangle(0, "can", (0.5, 0.0), (0.4, 0.7))
    assert free_places(rectangle(1, "can", (0.9, 0.0)), [target], target, CONFIG).shape == (0, 2)


def test_the_guess_is_about_the_middle() -> None:
    mesh = trimesh.creation.box(extents=EDGES)
    mesh.apply_translation([0.3, 0.2, 0.1])  # The mesh's frame is not its middle.
    model = make_target(mesh.vertices, mesh.faces)
    segment = Segment(number=0, contour=shapely.box(0.47, 0.07, 0.53, 0.13), top=0.2)
    guess = guess_of(segment, model.middle, EDGES, 0.0, ABOVE, CONFIG)
    assert_allclose(of_middle(guess.X, model.middle)[:3, 3], [0.5, 0.1, 0.1], atol=1e-6)
    assert guess.rotation_sigma == np.inf
    assert guess.translation_sigma == pytest.approx(
        CONFIG.middle_error
    )  # All of its length was seen.
    half = Segment(number=0, contour=shapely.box(0.47, 0.07, 0.53, 0.13), top=0.05)
    assert guess_of(half, model.middle, EDGES, 0.0, ABOVE, CONFIG).translation_sigma > 0.04
    glass = replace(segment, is_glass=True)
    guess = guess_of(glass, model.middle, EDGES, 0.0, ABOVE, CONFIG)  # It stands or lies.
    z, sigma = of_middle(guess.X, model.middle)[2, 3], guess.translation_sigma
    assert z - 1.5 * sigma < 0.03
    assert z + 1.5 * sigma > 0.1


def test_glass_that_stands_aside_of_the_camera_may_be_nearer_than_it_is_outlined() -> None:
    eye, edges = np.array([0.2, 0.1, 0.7]), np.array([0.08, 0.08, 0.2])
    true = np.array([0.5, 0.1])
    for height in (0.04, 0.2):  # It lies, or its rim is seen.
        seen = eye[:2] + (true - eye[:2]) * (0.7 - 0.04) / (0.7 - height)
        contour = shapely.Point(seen).buffer(0.04)
        glass = Segment(number=0, contour=contour, top=0.2, is_glass=True)
        guess = guess_of(glass, np.zeros(3), edges, 0.0, eye, CONFIG)
        above = guess_of(glass, np.zeros(3), edges, 0.0, np.append(seen, 0.7), CONFIG)
        off, wide = guess.X[:2, 3] - true, guess.translation_sigma
        assert np.linalg.norm(off) < 0.05 < 2.0 * wide
        assert wide > above.translation_sigma
        assert_allclose(above.X[:2, 3], seen, atol=1e-9)
