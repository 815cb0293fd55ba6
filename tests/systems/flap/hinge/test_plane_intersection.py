"""The axis by the paper's way: exact for a sheet, off by its thickness for a plate."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.flap.flap_geometry import HingeLimitsConfig
from crossmodal.systems.flap.hinge.plane_intersection import (
    PlaneIntersectionConfig,
    PlaneIntersectionState,
    intersection,
    update_intersection,
)
from crossmodal.systems.port_values import (
    FingertipContact,
    FlapPlane,
    TactileContact,
    unseen,
)

K_W = np.array([0.0, -0.6, 0.8])
P_WK = np.array([0.5, 0.1, 0.6])
P_WC = P_WK + np.array([0.02, 0.3, -0.05])
N_W = np.array([1.0, 0.0, 0.0])
CONFIG, LIMITS = PlaneIntersectionConfig(window=5), HingeLimitsConfig()


def face(theta: float, offset: float = 0.0, noise: Array | None = None) -> FlapPlane:
    """The front, `offset` before the axis, or the back once that is towards the camera."""
    n = se3.so3_exp(theta * K_W) @ N_W
    d = float(n @ P_WK) + offset
    n = n if noise is None else n + noise
    n, d = (-n, -d) if theta > 0.5 * np.pi else (n, d)
    return FlapPlane(seen=True, n_W=n / np.linalg.norm(n), d=d)


def touched() -> FingertipContact:
    n_S = np.array([0.0, 1.0, 0.0])
    contact = TactileContact(
        touching=True, p_SC=np.zeros(3), covariance=np.eye(3), n_S=n_S, f_S=0.5 * n_S
    )
    return FingertipContact(contact=contact, p_WC=P_WC)


@pytest.mark.parametrize("theta", [0.3, 1.2])
def test_planes_of_a_sheet_meet_in_its_hinge(theta: float) -> None:
    axis = intersection(face(0.0), face(theta), P_WC)
    assert_allclose(axis[:3], K_W, atol=1e-12)
    assert_allclose(axis[3:], P_WK + K_W * (K_W @ (P_WC - P_WK)), atol=1e-12)


def test_planes_of_a_plate_meet_beside_its_hinge() -> None:
    """Two lines that touch a circle of radius h meet h / cos(theta / 2) off its centre."""
    h, theta = 0.004, 1.0
    axis = intersection(face(0.0, h), face(theta, h), P_WC)
    off = axis[3:] - P_WK
    off -= K_W * (K_W @ off)
    assert np.linalg.norm(off) == pytest.approx(h / np.cos(0.5 * theta))


def test_the_axis_is_the_mean_over_a_window_and_keeps_its_sense_behind() -> None:
    rng = np.random.default_rng(0)
    state = PlaneIntersectionState(first=unseen(""), axes=np.empty((0, 6)))
    state = update_intersection(state, face(0.0), touched(), CONFIG, LIMITS)
    for count, theta in enumerate(np.linspace(0.0, 2.2, 45)):
        noise = 2e-3 * rng.normal(size=3)
        state = update_intersection(state, face(theta, 0.0, noise), touched(), CONFIG, LIMITS)
        assert state.belief.known == (count >= 7)
    belief = state.belief
    assert belief.k_W @ K_W > np.cos(0.01)
    spread = np.sqrt(np.trace(belief.covariance[:3, :3]))
    assert 1e-3 < spread < 5e-3
    assert len(state.axes) == CONFIG.window
    unchanged = update_intersection(state, unseen("dark"), touched(), CONFIG, LIMITS)
    assert unchanged is state
