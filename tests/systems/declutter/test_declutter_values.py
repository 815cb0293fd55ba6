"""The values of decluttering are compared by what they hold."""

import copy
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_PUSH,
    NO_TRIES,
    DeclutterAction,
    Push,
    Tries,
)
from tests.systems.declutter.scenes import image, random_scene, rectangle


def test_values_are_equal_where_all_that_they_hold_is() -> None:
    one, other = rectangle(3, "can", (0.5, 0.1)), rectangle(3, "can", (0.5, 0.1))
    assert one == other
    assert one != replace(other, name="box")
    assert one != replace(other, contour=other.contour + 1e-9)
    assert one != replace(other, top=0.1)
    assert image(one) == image(other)
    assert image(one) != image(other, number=2)
    assert image(one) != one
    assert Push(why="") == Push(why="")  # NaN included.


def test_graphs_of_the_same_scene_are_equal() -> None:
    graphs = [
        declutter_graph(image(*random_scene(seed)), "wineglass", {}, NO_TRIES, DeclutterConfig())
        for seed in (1, 1, 2)
    ]
    assert graphs[0] == graphs[1]
    assert graphs[0] != graphs[2]
    assert graphs[0] != NO_GRAPH


def test_values_are_not_written_and_not_copied() -> None:
    segment = rectangle(0, "can", (0.0, 0.0))
    assert copy.deepcopy(segment) is segment
    with pytest.raises(FrozenInstanceError):
        segment.name = "box"  # type: ignore[misc]


def test_failures_are_counted_by_object_and_action() -> None:
    grasp, push = DeclutterAction.GRASP, DeclutterAction.PUSH
    tries = NO_TRIES.with_failure(3, grasp).with_failure(3, grasp).with_failure(4, push)
    assert [tries.count(3, grasp), tries.count(3, push), tries.count(4, push)] == [2, 0, 1]
    assert Tries() == NO_TRIES  # It has not been written.


def test_a_graph_without_this_object_names_those_that_it_has() -> None:
    scene = image(rectangle(2, "can", (0.0, 0.0)), rectangle(7, "box", (0.05, 0.0)))
    graph = declutter_graph(scene, "can", {}, NO_TRIES, DeclutterConfig())
    assert graph.vertex(7).parent == 2
    with pytest.raises(KeyError, match=r"object 5 is not in the tree; there are \[2, 7\]"):
        graph.vertex(5)


def test_without_a_push_its_numbers_are_unknown() -> None:
    assert NO_PUSH.why
    assert np.isnan(NO_PUSH.point).all()
