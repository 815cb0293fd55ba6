"""Planned motions of the touching arm in its scene: free, straight where wanted, repeatable."""

from itertools import pairwise

import numpy as np
import pytest
from known_scene import CAMERA_AWAY, pose_at, touch_arm, touch_planner
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.controllers.arm.motion_planner import MotionPlanner, box_vertices
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.ur5 import UR5_HOME

ASIDE = UR5_HOME + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
HALFWAY = pose_at(touch_arm(), 0.5 * (UR5_HOME + ASIDE))[:3, 3]
CUBE = box_vertices(np.full(3, 0.1), RigidTransform(HALFWAY))
ABOVE_TABLE = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.55, 0.1, 0.25])
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def shared() -> MotionPlanner:
    return touch_planner()


@pytest.fixture
def planner(shared: MotionPlanner) -> MotionPlanner:
    shared.look_at(CAMERA_AWAY)
    return shared


def finely(path: Array) -> Array:
    """Postures (N, n) on its straight segments."""
    pieces = [np.linspace(a, b, max(int(np.abs(b - a).max() / 0.01), 2)) for a, b in pairwise(path)]
    return np.concatenate(pieces)


def test_where_nothing_is_in_the_way_the_path_is_straight(planner: MotionPlanner) -> None:
    path = planner.path(UR5_HOME, ASIDE, np.random.default_rng(0))
    assert_array_equal(path, [UR5_HOME, ASIDE])


@pytest.mark.parametrize("seed", range(3))
def test_a_path_leads_around_what_is_in_the_way(planner: MotionPlanner, seed: int) -> None:
    planner.look_at(CAMERA_AWAY, [CUBE])
    assert not planner.is_free(0.5 * (UR5_HOME + ASIDE))
    path = planner.path(UR5_HOME, ASIDE, np.random.default_rng(seed))
    assert path is not None
    assert len(path) > 2
    assert_array_equal(path[[0, -1]], [UR5_HOME, ASIDE])
    touching = touch_planner(clearance=0.0)  # Between checked postures the clearance may be less.
    touching.look_at(CAMERA_AWAY, [CUBE])
    assert all(touching.is_free(q) for q in finely(path))


def test_what_was_in_the_way_is_forgotten(planner: MotionPlanner) -> None:
    planner.look_at(CAMERA_AWAY, [CUBE])
    planner.look_at(CAMERA_AWAY)
    assert planner.is_free(0.5 * (UR5_HOME + ASIDE))


def test_the_other_arm_is_in_the_way_where_it_stands(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    over_it = np.array([0.2, 0.35, 0.0, -2.0, 0.0, 2.3, 0.0])
    planner.look_at({"camera_arm": over_it})
    assert not planner.is_free(q)


def test_the_same_seed_gives_the_same_path(planner: MotionPlanner) -> None:
    planner.look_at(CAMERA_AWAY, [CUBE])
    first, again, other = (
        planner.path(UR5_HOME, ASIDE, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_there_is_no_path_from_or_to_where_something_is_hit(planner: MotionPlanner) -> None:
    blocked = CUBE - HALFWAY + pose_at(touch_arm(), ASIDE)[:3, 3]
    planner.look_at(CAMERA_AWAY, [blocked])
    assert planner.path(UR5_HOME, ASIDE, np.random.default_rng(0)) is None
    assert planner.path(ASIDE, UR5_HOME, np.random.default_rng(0)) is None
    beyond = touch_arm().plant.GetPositionUpperLimits() + 0.1
    assert planner.path(UR5_HOME, beyond, np.random.default_rng(0)) is None


def test_what_stands_around_is_kept_clear_of() -> None:
    """A box 5 mm below the fingers' ends."""
    p = pose_at(touch_arm(), UR5_HOME)[:3, 3]
    box = box_vertices(np.array([0.1, 0.1, 0.02]), RigidTransform(p - [0.0, 0.0, 0.015]))
    for clearance, is_free in ((0.01, False), (0.001, True)):
        planner = touch_planner(clearance=clearance)
        planner.look_at(CAMERA_AWAY, [box])
        assert planner.is_free(UR5_HOME) == is_free


def test_a_posture_puts_the_end_effector_where_it_should_be(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    assert planner.is_free(q)
    assert_allclose(pose_at(touch_arm(), q), ABOVE_TABLE.GetAsMatrix4(), atol=1e-3)


@pytest.mark.parametrize("place", [[0.55, 0.1, 0.005], [-0.5, 0.0, 0.3]], ids=["table", "far"])
def test_there_is_no_posture_in_the_table_or_out_of_reach(
    planner: MotionPlanner, place: list[float]
) -> None:
    assert planner.posture(RigidTransform(ABOVE_TABLE.rotation(), place), [UR5_HOME]) is None


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8]])
def test_a_line_is_straight_and_does_not_turn(
    planner: MotionPlanner, direction: list[float]
) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    line = planner.line(q, np.array(direction), 0.12)
    X = np.array([pose_at(touch_arm(), q) for q in line])
    assert_array_equal(line[0], q)
    assert planner.length(line) == pytest.approx(0.12, abs=1e-4)
    steps = np.linspace(0.0, 0.12, len(line))[:, None]
    assert_allclose(X[:, :3, 3] - X[0, :3, 3], steps * direction, atol=1e-4)
    turns = [se3.so3_log(np.ascontiguousarray(X[0, :3, :3].T @ R)) for R in X[:, :3, :3]]
    assert_allclose(turns, np.zeros((len(line), 3)), atol=1e-4)


def test_a_line_ends_before_the_table(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    line = planner.line(q, DOWN, 0.5)
    assert all(planner.is_free(q) for q in line)
    assert 0.01 <= pose_at(touch_arm(), line[-1])[2, 3] < 0.021


def test_a_line_comes_nearer_to_the_table_with_less_clearance(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    for clearance in (0.003, None):
        planner.look_at(CAMERA_AWAY, clearance=clearance)
        line = planner.line(q, DOWN, ABOVE_TABLE.translation()[2] - 0.005)
        whole = planner.length(line) > 0.244
        assert whole == (clearance is not None)


def test_a_line_ends_where_the_arm_cannot_reach_any_more(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    line = planner.line(q, np.array([-1.0, 0.0, 0.0]), 2.0)
    assert 0.1 < planner.length(line) < 0.9
    assert np.abs(np.diff(line, axis=0)).max() < 0.4


def test_on_a_line_whose_hand_is_free_only_the_arm_hits_things(planner: MotionPlanner) -> None:
    """A low box is where the hand is at the line's end; a high one where the forearm is, too."""
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    x, y, _ = ABOVE_TABLE.translation()
    low = box_vertices(np.array([0.1, 0.1, 0.12]), RigidTransform([x, y, 0.06]))
    planner.look_at(CAMERA_AWAY, [low])
    assert planner.length(planner.line(q, DOWN, 0.2)) < 0.15
    whole = planner.line(q, DOWN, 0.2, hand_is_free=True)
    assert planner.length(whole) == pytest.approx(0.2, abs=1e-4)
    assert not planner.is_free(whole[-1])  # Afterwards the hand counts again.
    high = box_vertices(np.array([0.1, 0.1, 0.6]), RigidTransform([x, y, 0.3]))
    planner.look_at(CAMERA_AWAY, [high])
    assert len(planner.line(q, DOWN, 0.2, hand_is_free=True)) == 1


def test_a_hand_that_is_free_comes_down_to_the_table_and_below(planner: MotionPlanner) -> None:
    q = planner.posture(ABOVE_TABLE, [UR5_HOME])
    assert q is not None
    height = ABOVE_TABLE.translation()[2]
    assert planner.length(planner.line(q, DOWN, height + 0.01)) < height
    whole = planner.line(q, DOWN, height + 0.01, hand_is_free=True)
    assert planner.length(whole) == pytest.approx(height + 0.01, abs=1e-4)


def test_shapes_that_come_and_go_are_those_of_the_last_look(planner: MotionPlanner) -> None:
    aside = box_vertices(np.full(3, 0.1), RigidTransform([0.0, 0.9, 0.5]))
    for obstacles, is_free in (
        ([CUBE, aside], False),
        ([aside], True),
        ([aside, CUBE], False),
        ([CUBE], False),
        ([], True),
    ):
        planner.look_at(CAMERA_AWAY, obstacles)
        assert planner.is_free(0.5 * (UR5_HOME + ASIDE)) == is_free
