"""Boxes around objects, free places on a table, and the guess of a pose from an outline."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.affinity import translate

from crossmodal.maths.arrays import Array
from crossmodal.systems.declutter.around import (
    AroundConfig,
    boxes_around,
    free_places,
    guess_of_pose,
    line_of_sight,
)
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig
from crossmodal.systems.port_values import Segment
from tests.systems.declutter.scenes import random_scene, rectangle

CONFIG = AroundConfig()
TABLE = 0.02
AREA = shapely.Point(1.1, 0.0).buffer(0.8).intersection(shapely.box(0.0, -0.6, 1.4, 0.6))
EYE = np.array([0.3, 0.0, 0.45])
OFFSET = np.array([0.01, 0.0])  # Of the gripper from the object's middle.
# An upright box of 6 x 8 x 24 cm about its middle.
HULL = (
    0.5
    * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    * (
        0.06,
        0.08,
        0.24,
    )
)


@pytest.mark.parametrize("seed", range(5))
def test_a_box_holds_its_object_from_the_table_to_its_top(seed: int) -> None:
    scene = [replace(one, top=0.05 + 0.01 * one.number) for one in random_scene(seed)]
    for segment, (edges, X_WB) in zip(scene, boxes_around(scene, TABLE, CONFIG), strict=True):
        corners = shapely.get_coordinates(segment.contour)
        for z in (TABLE, TABLE + segment.top):
            p_W = np.column_stack([corners, np.full(len(corners), z)])
            p_B = (p_W - X_WB[:3, 3]) @ X_WB[:3, :3]
            assert (np.abs(p_B) <= 0.5 * edges + 1e-9).all()
        # It is no larger than that and the margin, and stands on the table.
        assert segment.box.area == pytest.approx((edges[0] - 0.02) * (edges[1] - 0.02))
        assert X_WB[2, 3] - 0.5 * edges[2] == pytest.approx(TABLE)


def test_an_object_of_unknown_height_is_taken_for_a_high_one() -> None:
    ((edges, _),) = boxes_around([rectangle(0, "can", (0.5, 0.0))], TABLE, CONFIG)
    assert edges[2] == pytest.approx(CONFIG.unknown_top + CONFIG.margin)


def _places(seed: int, config: AroundConfig = CONFIG) -> tuple[Array, Segment, list[Segment]]:
    target, moved, *others = (replace(one, top=0.1) for one in random_scene(seed))
    p_WE = moved.centroid + OFFSET
    found = free_places(moved, p_WE, [target, *others], target, EYE, AREA, config)
    return found, moved, [target, *others]


@pytest.mark.parametrize("seed", range(5))
def test_places_are_reachable_apart_from_all_others_and_hide_nothing(seed: int) -> None:
    places, moved, others = _places(seed)
    assert len(places) > 10
    sight = line_of_sight(others[0], EYE, 0.1)
    p_WE = moved.centroid + OFFSET
    for place in places[::20]:
        put = translate(moved.contour, *(place - p_WE))
        assert AREA.covers(put)
        assert min(put.distance(other.contour) for other in others) >= CONFIG.least_apart - 1e-9
        assert not put.intersects(sight)


def test_the_nearest_place_comes_first_among_those_far_enough_from_all() -> None:
    places, moved, others = _places(0)
    p_WE = moved.centroid + OFFSET
    away = np.array(
        [
            min(
                translate(moved.contour, *(place - p_WE)).distance(other.contour)
                for other in others
            )
            for place in places
        ]
    )
    far = away >= CONFIG.apart - 1e-9
    count = int(far.sum())
    assert 0 < count < len(places)
    assert far[:count].all()
    ways = np.linalg.norm(places[:count] - p_WE, axis=1)
    assert (np.diff(ways) >= -1e-9).all()
    assert (np.diff(away[count:]) <= 1e-9).all()


def test_what_is_put_down_hangs_on_nothing() -> None:
    assert CONFIG.apart > DeclutterConfig().near


def test_where_everything_is_full_there_is_no_place() -> None:
    full = rectangle(2, "box", (0.8, 0.0), (3.0, 3.0))
    moved = rectangle(1, "can", (0.5, 0.0))
    target = rectangle(0, "oil", (0.5, 0.1))
    places = free_places(moved, moved.centroid, [target, full], target, EYE, AREA, CONFIG)
    assert places.shape == (0, 2)


@pytest.mark.parametrize("height", [0.05, 0.2, 0.6])
def test_what_stands_outside_the_line_of_sight_hides_no_point_of_the_foot(height: float) -> None:
    target = rectangle(0, "oil", (0.6, 0.1), (0.08, 0.2), angle=0.4)
    sight = line_of_sight(target, EYE, height)
    rng = np.random.default_rng(0)
    corners = shapely.get_coordinates(target.contour)[:-1]
    feet = rng.dirichlet(np.ones(4), size=200) @ corners
    # Along each ray, from the foot to the eye, what is lower than the height lies within it.
    for s in np.linspace(0.0, 1.0, 20):
        if s * EYE[2] <= height:
            at = feet + s * (EYE[:2] - feet)
            assert shapely.distance(sight, shapely.points(at)).max() < 1e-9
    behind = shapely.Point(corners.mean(axis=0) + 2.0 * (corners.mean(axis=0) - EYE[:2]))
    assert not sight.intersects(behind)


def test_the_guess_of_a_standing_object_stands_and_that_of_a_lying_one_lies() -> None:
    middle = np.array([0.0, 0.0, 0.12])
    stands = guess_of_pose(
        rectangle(0, "oil", (0.5, 0.1), (0.06, 0.08)), HULL, middle, TABLE, CONFIG
    )
    np.testing.assert_allclose(stands.X[2, :3], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(stands.X[:3, 3], [0.5, 0.1, TABLE], atol=1e-9)
    segment = rectangle(0, "oil", (0.5, 0.1), (0.24, 0.06), angle=0.5)
    lies = guess_of_pose(segment, HULL, middle, TABLE, CONFIG)
    along = lies.X[:3, 2]
    assert abs(along @ [np.cos(0.5), np.sin(0.5), 0.0]) == pytest.approx(1.0)
    X_WM = lies.X @ np.vstack([np.column_stack([np.eye(3), middle]), [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(X_WM[:2, 3], [0.5, 0.1], atol=1e-9)
    assert (HULL @ X_WM[2, :3] + X_WM[2, 3]).min() == pytest.approx(TABLE)
    assert lies.translation_sigma == pytest.approx(CONFIG.middle_error)
    assert lies.rotation_sigma == np.inf


def test_the_guess_is_the_less_certain_the_more_of_the_object_is_hidden() -> None:
    def sigma(seen: float) -> float:
        segment = rectangle(0, "oil", (0.5, 0.1), (seen, 0.06))
        return guess_of_pose(segment, HULL, np.zeros(3), TABLE, CONFIG).translation_sigma

    sigmas = [sigma(seen) for seen in (0.24, 0.18, 0.12, 0.07)]
    assert (np.diff(sigmas) > 0.005).all()
    # The true middle is off by half of what is hidden, at most.
    assert sigma(0.12) == pytest.approx(np.hypot(0.01, 0.06 / np.sqrt(3.0)))
