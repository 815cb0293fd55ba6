"""The roll towards the flap, the arc and the alignment with the hinge, in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.controllers.servoing.twists import from_contact
from crossmodal.controllers.servoing.visual_servoing import (
    VisualServoingConfig,
    approaching_twist,
    fused_distance,
    hinge_distance,
    roll_angle,
    seen_misalignment,
    servoing_twist,
    towards_hinge,
)
from crossmodal.maths import se3
from crossmodal.systems.port_values import FlapAngleBelief, FlapPlane, HingeBelief

CONFIG = VisualServoingConfig()
P_SC = np.array([0.0, 0.01, 0.0])
K_W = np.array([0.0, -1.0, 0.0])
# x_S along world x, y_S up, z_S along the hinge.
X_WS_START = np.eye(4)
X_WS_START[:3, :3] = np.column_stack([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], K_W])
X_WS_START[:3, 3] = [0.0, 0.0, -0.095]


def flap(theta: float, deviation: float = 0.01) -> FlapAngleBelief:
    """A flap that hangs from a hinge at the origin and faces x at first."""
    return FlapAngleBelief(
        known=True,
        theta=theta,
        variance=deviation**2,
        rate=0.0,
        n_W=np.array([np.cos(theta), 0.0, np.sin(theta)]),
        n_covariance=0.5 * deviation**2 * np.eye(3),
    )


def hinge(k_W: np.ndarray = K_W, deviation: float = 1e-3) -> HingeBelief:
    covariance = deviation**2 * np.eye(6)
    return HingeBelief(known=True, k_W=k_W, p_WK=np.zeros(3), covariance=covariance)


def rolled(angle: float) -> np.ndarray:
    X = X_WS_START.copy()
    X[:3, :3] = se3.so3_exp(angle * K_W) @ X[:3, :3]
    return X


def twist(X_WS: np.ndarray, feed=0.0, slide=0.0, rise=0.0, angle=None, axis=None):  # type: ignore[no-untyped-def]
    return servoing_twist(X_WS, P_SC, feed, np.array([slide, rise, 0.0]), angle, axis, CONFIG)


def test_the_target_is_along_the_flap_to_the_hinge() -> None:
    for theta in np.deg2rad([0.0, 40.0, 120.0]):
        edge = np.array([np.sin(theta), 0.0, -np.cos(theta)])
        assert_allclose(towards_hinge(flap(theta).n_W, K_W), -edge, atol=1e-12)


@pytest.mark.parametrize("theta", np.deg2rad([0.0, 60.0, 120.0]))
def test_the_roll_is_zero_where_the_normals_are_orthogonal(theta: float) -> None:
    R = rolled(theta)[:3, :3]
    assert roll_angle(R[:, 1], R[:, 2], flap(theta).n_W) == pytest.approx(0.0, abs=1e-12)
    assert R[:, 1] @ flap(theta).n_W == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("error", np.deg2rad([-100.0, -20.0, 5.0, 100.0]))
def test_the_roll_reduces_any_misalignment(error: float) -> None:
    """The literal product n x n_f would be zero at 90 deg of misalignment only."""
    V = twist(rolled(1.0 + error), angle=flap(1.0))
    assert V[2] * error < 0.0
    assert_allclose(V[[0, 1, 3, 4, 5]], 0.0, atol=1e-12)


def test_the_roll_is_limited() -> None:
    assert twist(rolled(2.0), angle=flap(0.0))[2] == pytest.approx(-CONFIG.turn_limit)


def test_a_flap_that_is_hardly_known_turns_nothing() -> None:
    assert_allclose(twist(rolled(1.0), angle=flap(0.0, deviation=1.0)), 0.0)


def test_the_finger_turns_with_the_arc_about_the_known_hinge() -> None:
    V = twist(rolled(0.7), feed=0.007, slide=-0.002, axis=hinge())
    centre = rolled(0.7)[:3, 3] + rolled(0.7)[:3, :3] @ P_SC
    assert V[2] == pytest.approx(0.005 / np.linalg.norm(centre), rel=1e-3)
    assert V[3] == pytest.approx(0.007)


def test_an_unknown_hinge_is_taken_to_be_at_a_typical_distance() -> None:
    assert twist(rolled(0.0), feed=0.007)[2] == pytest.approx(0.007 / CONFIG.typical_distance)


def test_the_distance_is_trusted_as_far_as_it_is_known() -> None:
    p_WC = np.array([0.0, 0.3, -0.05])
    distance, sigma = hinge_distance(p_WC, hinge(deviation=0.004))
    assert distance == pytest.approx(0.05)
    assert sigma == pytest.approx(0.004)
    assert fused_distance(p_WC, hinge(deviation=1e-6), CONFIG) == pytest.approx(0.05)
    vague = fused_distance(p_WC, hinge(deviation=10.0), CONFIG)
    assert vague == pytest.approx(CONFIG.typical_distance, rel=1e-4)
    at_hinge = fused_distance(np.zeros(3), hinge(), CONFIG)
    assert at_hinge == pytest.approx(CONFIG.typical_distance)


def test_the_finger_aligns_with_the_hinge() -> None:
    k_W = se3.so3_exp(np.array([0.05, 0.0, -0.03])) @ K_W
    X, start = X_WS_START.copy(), np.arccos(X_WS_START[:3, 2] @ k_W)
    for _ in range(100):
        V = twist(X, axis=hinge(k_W))
        X = X @ se3.exp(0.05 * np.concatenate([V[:3], np.zeros(3)]))
    assert np.arccos(min(1.0, X[:3, 2] @ k_W)) < 0.1 * start


@pytest.mark.parametrize("off", [np.zeros(3), np.array([0.1, 0.2, -0.3])])
def test_the_contact_does_not_slide_along_the_hinge(off: np.ndarray) -> None:
    X = X_WS_START.copy()
    X[:3, :3] = X[:3, :3] @ se3.so3_exp(off)
    V = twist(X, feed=0.007, slide=-0.002, rise=0.001, axis=hinge())
    v_W = X[:3, :3] @ (V[3:] + np.array([-0.002, 0.001, 0.0]))
    assert v_W @ K_W == pytest.approx(0.0, abs=1e-15)
    assert V[3] == pytest.approx(0.007)
    assert twist(X, feed=0.007)[5] == 0.0


EDGE_W = np.array([0.1, -1.0, 0.0]) / np.hypot(0.1, 1.0)
SEEN = FlapPlane(
    seen=True,
    n_W=np.array([1.0, 0.1, 0.0]) / np.hypot(0.1, 1.0),
    edge_W=EDGE_W,
    p_WG=np.array([0.0, 0.0, -0.05]) + 0.04 * EDGE_W,
)


@pytest.mark.parametrize("error", [np.array([0.1, -0.15, 0.2]), np.array([-0.2, 0.1, -0.3])])
def test_before_it_touches_the_finger_turns_to_the_flap_about_the_edge(error: np.ndarray) -> None:
    X, edge = X_WS_START.copy(), np.array([0.0, 0.045, 0.0])
    X[:3, :3] = X[:3, :3] @ se3.so3_exp(error)
    X[:3, 3] = np.array([0.0, 0.0, -0.05]) - X[:3, :3] @ edge
    for _ in range(400):
        V = approaching_twist(X, SEEN, 0.01, np.ones(6), CONFIG)
        assert np.abs(V[:3]).max() <= CONFIG.turn_limit
        assert_allclose(from_contact(V, -edge)[3:], 0.0, atol=1e-9)
        X = X @ se3.exp(0.02 * V)
    assert_allclose(X[:3, :3] @ edge + X[:3, 3], [0.0, 0.0, -0.05], atol=1e-6)
    assert X[:3, 0] @ SEEN.n_W == pytest.approx(1.0, abs=1e-4)
    assert X[:3, 2] @ EDGE_W == pytest.approx(1.0, abs=1e-4)


def test_without_an_edge_the_finger_turns_to_the_normal_about_its_pad() -> None:
    plane, X = replace(SEEN, edge_W=np.full(3, np.nan)), X_WS_START.copy()
    before = seen_misalignment(X[:3, :3], plane)
    assert np.linalg.norm(before) == pytest.approx(np.arctan(0.1))
    assert before[0] == 0.0
    V = approaching_twist(X, plane, 0.01, np.ones(6), CONFIG)
    assert_allclose(from_contact(V, np.array([0.0, -0.01, 0.0]))[3:], 0.0, atol=1e-15)
    X[:3, :3] = X[:3, :3] @ se3.so3_exp(before)
    assert X[:3, 0] @ plane.n_W == pytest.approx(1.0)
    assert_allclose(seen_misalignment(X[:3, :3], plane), 0.0, atol=1e-9)
