import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import THICKNESS, WIDTH
from crossmodal.systems.grasping.grasp_geometry import (
    fingertip_height,
    highest_under_fingers,
    is_blocked,
    levers,
    tops,
)
from crossmodal.systems.grasping.height_map import CELL, CELLS, HeightMap

EMPTY = np.zeros((CELLS, CELLS))
VIEW = HeightMap(heights=EMPTY, others=EMPTY, corner=np.full(2, -0.5 * (CELLS - 1) * CELL))
ANGLE = 0.4


def post(x: float, y: float, height: float) -> Array:
    """Heights of a thin post at a place in x and y of the grasp."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    column, row = np.round(VIEW.cells(np.array([c * x - s * y, s * x + c * y]))).astype(int)
    heights = EMPTY.copy()
    heights[row - 1 : row + 2, column - 1 : column + 2] = height
    return heights


def grasp(z: float = 0.02) -> Array:
    return np.array([[0.0, 0.0, ANGLE, 0.06, z]])


def test_fingers_go_deep_but_not_into_the_table() -> None:
    assert_allclose(fingertip_height(np.array([0.0, 0.02, 0.1])), [0.001, 0.001, 0.055])


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("x", "y", "blocked"),
    [
        (0.03 + 0.5 * THICKNESS, 0.0, True),
        (0.03 + 0.5 * THICKNESS, 0.45 * WIDTH, True),
        (0.02, 0.0, False),
        (0.03 + THICKNESS + 0.005, 0.0, False),
        (0.03 + 0.5 * THICKNESS, 0.5 * WIDTH + 0.005, False),
    ],
)
def test_a_post_is_in_the_way_where_a_finger_comes_down(
    side: float, x: float, y: float, blocked: bool
) -> None:
    assert is_blocked(post(side * x, y, 0.03), grasp(), VIEW)[0] == blocked
    assert not is_blocked(post(side * x, y, 0.01), grasp(), VIEW)[0]
    higher = highest_under_fingers(post(side * x, y, 0.03), grasp(), VIEW)[0]
    assert higher == (0.03 if blocked else 0.0)


def test_a_tall_post_is_in_the_way_of_the_palm() -> None:
    assert is_blocked(post(0.0, 0.0, 0.15), grasp(), VIEW)[0]
    assert not is_blocked(post(0.0, 0.0, 0.15), grasp(0.04), VIEW)[0]
    assert not is_blocked(post(0.0, 0.06, 0.15), grasp(), VIEW)[0]


def test_room_is_kept_around_the_fingers() -> None:
    near = post(0.03 + THICKNESS + 0.005, 0.0, 0.03)
    assert highest_under_fingers(near, grasp(), VIEW, around=0.006)[0] == 0.03


def test_the_top_is_that_of_the_object_between_the_fingers() -> None:
    assert tops(post(0.005, 0.0, 0.04), grasp(), VIEW)[0] == 0.04
    assert tops(post(0.03, 0.0, 0.04), grasp(), VIEW)[0] == 0.0


def test_a_weight_pulls_where_it_is_beside_the_fingers_across_their_opening() -> None:
    heights = np.zeros((CELLS, CELLS))
    heights[60:80, 20:100] = 0.02
    heights[60:80, 100:120] = 0.08  # One end is as heavy as all the rest.
    view = HeightMap(heights=heights, others=np.zeros_like(heights), corner=np.zeros(2))
    x, y = CELL * (0.5 * (59.5 + 109.5)), CELL * 69.5
    along, across = [x + 0.05, y, 0.0, 0.1, 0.0], [x + 0.05, y, 0.5 * np.pi, 0.05, 0.0]
    assert_allclose(levers(heights, np.array([along, across]), view), [0.0, 0.05], atol=1e-9)
