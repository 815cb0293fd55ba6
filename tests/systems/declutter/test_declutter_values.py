"""The values of decluttering."""

import copy
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.port_values import (
    NO_TRIES,
    DeclutterAction,
    Push,
    Segment,
    Tries,
)
from tests.systems.declutter.scenes import image, rectangle, rotation


@pytest.mark.parametrize(
    "corners", [[[0, 0], [1, 1], [1, 0], [0, 1]], [[0, 0], [1, 0], [2, 0]], []]
)
def test_a_contour_without_an_area_or_that_crosses_itself_is_refused(
    corners: list[list[float]],
) -> None:
    with pytest.raises(ValueError, match="object 3: the contour must have an area"):
        Segment(number=3, contour=shapely.Polygon(corners))


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4.0, -2.0])
def test_box_and_centroid_are_those_of_the_contour(angle: float) -> None:
    segment = rectangle(0, "", (0.4, -0.7), (0.12, 0.04), angle)
    assert_allclose(segment.centroid, [0.4, -0.7])
    assert segment.box.symmetric_difference(segment.contour).area < 1e-12


@pytest.mark.parametrize("seed", range(10))
def test_no_turned_box_is_smaller(seed: int) -> None:
    hull = shapely.MultiPoint(np.random.default_rng(seed).normal(size=(20, 2))).convex_hull
    points = shapely.get_coordinates(hull)
    turns = np.linspace(0.0, 0.5 * np.pi, 5000)
    least = min(np.prod(np.ptp(points @ rotation(turn), axis=0)) for turn in turns)
    box = Segment(number=0, contour=hull).box
    assert box.buffer(1e-9).contains(hull)
    assert box.area == pytest.approx(least, rel=1e-3)
    assert box.area <= least + 1e-12


def test_values_are_not_written_and_not_copied() -> None:
    segment = rectangle(0, "can", (0.0, 0.0))
    assert copy.deepcopy(segment) is segment
    with pytest.raises(FrozenInstanceError):
        segment.name = "box"  # type: ignore[misc]


def test_failures_are_counted_by_object_and_action() -> None:
    grasp, push = DeclutterAction.GRASP, DeclutterAction.PUSH
    tries = NO_TRIES
    for number, action, hindered in ((3, grasp, False), (3, grasp, True), (4, push, False)):
        tries = tries.with_failure(number, action, hindered)
    assert [tries.count(3, grasp), tries.count(3, push), tries.count(4, push)] == [2, 0, 1]
    assert Tries() == NO_TRIES  # It has not been written.
    tries = tries.out_of_reach(4, grasp)  # That is not tried again before something was moved.
    assert [tries.may(3, grasp, 3), tries.may(4, push, 1), tries.may(4, grasp, 3)] == [
        True,
        False,
        False,
    ]
    tries = tries.blocked_at(np.array([[0.1, 0.0], [0.3, 0.0]]))
    gone = shapely.box(0.0, -0.1, 0.2, 0.1)
    elsewhere, here = tries.after_motion({3}, shapely.Polygon()), tries.after_motion({4, 5}, gone)
    assert [elsewhere.count(3, grasp), elsewhere.may(4, grasp, 3)] == [1, False]
    assert [here.count(3, grasp), here.may(4, grasp, 3)] == [2, True]
    assert len(shapely.get_parts(elsewhere.blocked)) == 2
    assert shapely.get_coordinates(here.blocked).tolist() == [[0.3, 0.0]]


def test_a_graph_without_this_object_names_those_that_it_has() -> None:
    scene = image(rectangle(2, "can", (0.0, 0.0)), rectangle(7, "box", (0.05, 0.0)))
    graph = declutter_graph(scene, "can", {}, NO_TRIES, DeclutterConfig())
    assert graph.vertex(7).parent == 2
    with pytest.raises(KeyError, match=r"object 5 is not in the tree; there are \[2, 7\]"):
        graph.vertex(5)


def test_without_a_push_its_numbers_are_unknown() -> None:
    assert np.isnan(Push(why="none").point).all()
