"""Contacts and free space of one touch, in closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.pose.touch_contacts import contact_points, swept_lines

RADIUS = 0.003
P_ES = np.array([[0.01, 0.0, -0.003], [-0.01, 0.005, -0.003], [0.0, 0.0, -0.02]])
X_WE = se3.exp(np.array([0.3, -1.0, 0.5, 0.4, -0.2, 0.3]))


def test_a_pressed_taxel_touches_on_the_side_from_which_it_is_pushed() -> None:
    """A ball's surface meets the first taxel: the force on this points away from the ball."""
    n_W = np.array([0.6, 0.0, 0.8])
    forces = np.zeros((3, 3))
    forces[0] = X_WE[:3, :3].T @ (0.5 * n_W)
    points, normals = contact_points(X_WE, P_ES, forces, RADIUS, 0.1)
    middle = X_WE[:3, :3] @ P_ES[0] + X_WE[:3, 3]
    assert_allclose(points, [middle - RADIUS * n_W], atol=1e-12)
    assert_allclose(normals, [n_W], atol=1e-12)


def test_only_taxels_beyond_the_threshold_are_pressed() -> None:
    forces = np.array([[0.0, 0.06, -0.08], [0.0, 0.0, -0.11], [0.2, 0.0, 0.0]])
    points, normals = contact_points(np.eye(4), P_ES, forces, RADIUS, 0.1001)
    assert_allclose(normals, [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    assert_allclose(points, P_ES[1:] + np.array([[0.0, 0.0, RADIUS], [-RADIUS, 0.0, 0.0]]))
    points, normals = contact_points(np.eye(4), P_ES, forces, RADIUS, 1.0)
    assert points.shape == normals.shape == (0, 3)


@pytest.mark.parametrize("met", [False, True])
def test_taxels_sweep_straight_lines_up_to_a_contact(met: bool) -> None:
    way = np.array([0.0, 0.06, -0.08])
    X_end = X_WE.copy()
    X_end[:3, 3] += way
    ends = np.array([0, 2])
    lines = swept_lines(X_WE, X_end, P_ES, ends, met)
    starts = P_ES[ends] @ X_WE[:3, :3].T + X_WE[:3, 3]
    assert_allclose(lines[:, 0], starts, atol=1e-12)
    # The last few millimetres before what is met are not known to be free.
    assert_allclose(lines[:, 1], starts + (0.96 if met else 1.0) * way, atol=1e-12)


def test_a_touch_that_has_hardly_moved_sweeps_nothing() -> None:
    X_end = X_WE.copy()
    X_end[:3, 3] += [0.0, 0.0, -0.002]
    assert swept_lines(X_WE, X_end, P_ES, np.array([0, 1]), True).shape == (0, 2, 3)
    assert swept_lines(X_WE, X_WE, P_ES, np.array([0, 1]), False).shape == (0, 2, 3)
