"""The tool as a link: composition and covariances."""

import numpy as np
from numpy.testing import assert_allclose
from synthetic_flap import Laboratory, pose

from maths import se3
from systems.flap.flap_lever import lever, place_error
from systems.flap.tool_kinematics import tool_link
from systems.port_values import FlapAngleBelief, HingeBelief, ToolBelief

LAB = Laboratory(1)
THETA = 0.8
CONTACT = LAB.contact(THETA, 0.08)


def _hinge(touch_covariance: np.ndarray | None = None) -> HingeBelief:
    k = LAB.tool.k_W
    p = LAB.tool.p_WK + k * (k @ (CONTACT.p_WC - LAB.tool.p_WK))
    across = np.eye(3) - np.outer(k, k)
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = 0.004**2 * across
    return HingeBelief(
        known=True, k_W=k, p_WK=p, covariance=covariance,
        touch_offset=np.array([0.001, 0.0, 0.002]),
        touch_covariance=np.zeros((9, 3)) if touch_covariance is None else touch_covariance,
    )  # fmt: skip


def _angle() -> FlapAngleBelief:
    n = LAB.tool.frame(THETA)[:, 1]
    return FlapAngleBelief(
        known=True, theta=THETA, variance=1e-4, rate=0.08, n_W=n, n_covariance=1e-4 * np.eye(3)
    )


def _tool() -> ToolBelief:
    return tool_link(_hinge(), _angle(), CONTACT, LAB.end_effector())


def test_the_links_lead_from_the_end_effector_to_the_contact() -> None:
    tool, X_WE = _tool(), LAB.end_effector().X
    X_WT = X_WE @ tool.X_EK @ tool.X_KT
    assert_allclose(X_WT[:3, 3], X_WE[:3, 3] + tool.L1_W - tool.L2_W, atol=1e-12)
    across = np.eye(3) - np.outer(LAB.tool.k_W, LAB.tool.k_W)
    touched = CONTACT.p_WC - _hinge().touch_offset
    assert_allclose(across @ X_WT[:3, 3], across @ touched, atol=1e-12)
    for X in (tool.X_EK, tool.X_KT, X_WT):
        assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)


def test_the_hinges_frame_does_not_turn_with_the_flap() -> None:
    tool = _tool()
    R_WK = (LAB.end_effector().X @ tool.X_EK)[:3, :3]
    assert_allclose(R_WK[:, 2], LAB.tool.k_W, atol=1e-12)
    back = se3.so3_exp(-THETA * LAB.tool.k_W) @ -tool.L2_W
    assert_allclose(R_WK[:, 0], back / np.linalg.norm(back), atol=1e-12)
    assert_allclose(tool.X_KT[:3, :3], se3.so3_exp(np.array([0.0, 0.0, THETA])))


def test_the_lever_does_not_suffer_from_what_displaces_axis_and_contact_together() -> None:
    C = 0.005**2 * np.eye(3)
    across = np.eye(3) - np.outer(LAB.tool.k_W, LAB.tool.k_W)
    by_touch = np.vstack([np.zeros((3, 3)), -across @ C, C])
    alone = _hinge(by_touch)
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = across @ C @ across + 1e-8 * across
    arm = lever(HingeBelief(**{**vars(alone), "covariance": covariance}), CONTACT)
    assert np.sqrt(arm.length_variance) < 0.001
    # With an axis that is known otherwise, the contact's displacement counts.
    independent = np.vstack([np.zeros((6, 3)), C])
    other = lever(HingeBelief(**{**vars(alone), "touch_covariance": independent}), CONTACT)
    assert np.sqrt(other.length_variance) > 0.005


def test_what_is_left_of_a_contacts_error_is_its_place_on_the_fingertip() -> None:
    values = np.linalg.eigvalsh(place_error(CONTACT))
    assert_allclose(values, 0.0005**2 + 0.0002**2, rtol=1e-6)


def test_the_first_link_has_the_holders_calibration_in_it() -> None:
    tool, E = _tool(), LAB.end_effector()
    R = E.X[:3, :3]
    holder = R @ E.covariance[3:6, 3:6] @ R.T
    rest = tool.L1_covariance - holder
    assert np.all(np.linalg.eigvalsh(rest) > -1e-12)
    assert pose(R, E.X[:3, 3])[0, 3] == E.X[0, 3]
