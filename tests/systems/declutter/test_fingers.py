"""Where fingers come down, and what has stopped one before."""

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from crossmodal.models.gripper_taxels import THICKNESS, TRAVEL, WIDTH
from crossmodal.systems.declutter.fingers import comes_down, fingers_of, grasps_left
from crossmodal.systems.port_values import NO_TRIES, Grasp, Grasps, Push

X_WE = np.eye(4)
X_WE[:2, 3] = [0.5, 0.1]
GRASP = Grasp(X_WE=X_WE, width=0.04, quality=0.9)


def test_fingers_stand_on_both_sides_of_the_middle() -> None:
    outer = 0.02 + THICKNESS
    bounds = [0.5 - outer, 0.1 - 0.5 * WIDTH, 0.5 + outer, 0.1 + 0.5 * WIDTH]
    found = fingers_of(GRASP)
    assert_allclose(found.bounds, bounds)
    assert found.area == pytest.approx(2.0 * THICKNESS * WIDTH)
    assert not shapely.intersects_xy(found, 0.5, 0.1)


def test_no_grasp_is_wider_than_the_gripper_opens() -> None:
    wide = fingers_of(Grasp(X_WE=X_WE, width=1.0, quality=0.9))
    assert wide.bounds[2] == pytest.approx(0.5 + TRAVEL + THICKNESS)


def test_closed_fingers_of_a_push_are_one_rectangle_along_it() -> None:
    push = Push(place=np.array([0.5, 0.1]), direction=np.array([0.0, 1.0]))
    bounds = fingers_of(push).bounds
    half = 0.5 * WIDTH
    assert_allclose(bounds, [0.5 - half, 0.1 - THICKNESS, 0.5 + half, 0.1 + THICKNESS])


def test_what_has_stopped_a_finger_stops_it_again() -> None:
    under, between = (NO_TRIES.blocked_at(np.array([[x, 0.1]])) for x in (0.525, 0.5))
    assert comes_down(GRASP, NO_TRIES)
    assert not comes_down(GRASP, under)
    aside = NO_TRIES.blocked_at(np.array([[0.525, 0.15]]))
    assert comes_down(GRASP, aside)
    assert comes_down(GRASP, between)
    assert grasps_left(Grasps(number=1, grasps={3: (GRASP,), 4: ()}), under) == {3: (), 4: ()}
