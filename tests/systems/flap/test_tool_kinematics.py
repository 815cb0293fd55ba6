"""The tool as a link: composition and covariances."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
from synthetic_flap import Laboratory

from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import (
    LineState,
    ToolLineConfig,
    next_line_state,
)
from crossmodal.maths import se3
from crossmodal.systems.flap.flap_geometry import lever, place_error
from crossmodal.systems.flap.tool_kinematics import (
    ToolKinematicsConfig,
    ToolState,
    tool_link,
    update_tool,
)
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    FlapAngleBelief,
    HingeBelief,
    ToolBelief,
)

LAB = Laboratory(1)
THETA = 0.8
CONTACT = LAB.contact(THETA, 0.08)


OFFSET = np.array([0.001, 0.0, 0.002])
HOLDER = np.array([0.004, -0.003, 0.001])


def _hinge(displacement_covariance: np.ndarray | None = None) -> HingeBelief:
    k = LAB.tool.k_W
    p = LAB.tool.p_WK + k * (k @ (CONTACT.p_WC - LAB.tool.p_WK))
    across = np.eye(3) - np.outer(k, k)
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = 0.004**2 * across
    return HingeBelief(
        known=True, k_W=k, p_WK=p, covariance=covariance,
        p_WQ=CONTACT.p_WC,
        displacements=np.concatenate([np.zeros(3), OFFSET, np.zeros(3), HOLDER]),
        displacement_covariance=(
            np.zeros((18, 12)) if displacement_covariance is None else displacement_covariance
        ),
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
    # Where the holder's arm says it is, which is itself displaced.
    touched = CONTACT.p_WC - OFFSET + HOLDER
    assert_allclose(across @ X_WT[:3, 3], across @ touched, atol=1e-12)
    for X in (tool.X_EK, tool.X_KT, X_WT):
        assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)


def test_on_the_line_the_holders_displacement_is_taken_off_once() -> None:
    X_WE = LAB.end_effector().X
    state = next_line_state(LineState(), 0.0, X_WE, FlipPhase.RETREAT, _tool(), ToolLineConfig())
    across = np.eye(3) - np.outer(LAB.tool.k_W, LAB.tool.k_W)
    touched = CONTACT.p_WC - OFFSET
    assert_allclose(across @ state.tip(X_WE)[:3, 3], across @ touched, atol=1e-12)
    assert_allclose(state.displacement, HOLDER, atol=1e-12)


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
    by_touch = np.zeros((18, 12))
    by_touch[3:6, 3:6], by_touch[9:12, 3:6] = -across @ C, C
    alone = _hinge(by_touch)
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = across @ C @ across + 1e-8 * across
    arm = lever(replace(alone, covariance=covariance), CONTACT)
    assert np.sqrt(arm.length_variance) < 0.001
    # With an axis that is known otherwise, the contact's displacement counts.
    independent = by_touch.copy()
    independent[3:6] = 0.0
    other = lever(replace(alone, displacement_covariance=independent), CONTACT)
    assert np.sqrt(other.length_variance) > 0.005


def test_what_is_left_of_a_contacts_error_is_its_place_on_the_fingertip() -> None:
    values = np.linalg.eigvalsh(place_error(CONTACT))
    assert_allclose(values, 0.0005**2 + 0.0002**2, rtol=1e-6)


def test_the_first_link_is_as_sure_as_hinge_and_holder_are_against_each_other() -> None:
    C = 0.005**2 * np.eye(3)

    def reported(with_hinge: float) -> np.ndarray:
        P = np.zeros((18, 12))
        P[15:, 9:], P[3:6, 9:] = C, with_hinge * C
        hinge = replace(_hinge(P), covariance=np.diag(np.append(np.zeros(3), np.diag(C))))
        return tool_link(hinge, _angle(), CONTACT, LAB.end_effector()).L1_covariance

    k, E = LAB.tool.k_W, LAB.end_effector()
    R = E.X[:3, :3]
    rest = float(k @ place_error(CONTACT) @ k) * np.outer(k, k)
    rest = rest + R @ E.white_covariance[3:6, 3:6] @ R.T
    assert_allclose(reported(0.0), 2.0 * C + rest, atol=1e-12)
    # An axis that the camera sees where it sees the holder errs as the holder's place does.
    assert_allclose(reported(-1.0), rest, atol=1e-12)


def _untouched(state: ToolState, angle: FlapAngleBelief, X_EE: np.ndarray) -> ToolState:
    hand = LAB.end_effector()
    moved = replace(hand, X=hand.X @ X_EE)
    config = ToolKinematicsConfig()
    return update_tool(state, _hinge(), angle, UNKNOWN_FINGERTIP, moved, config)


def _touched() -> ToolState:
    return update_tool(
        ToolState(), _hinge(), _angle(), CONTACT, LAB.end_effector(), ToolKinematicsConfig()
    )


def test_a_flap_that_nobody_touches_turns_in_the_tool_as_it_is_seen() -> None:
    turned = replace(_angle(), theta=THETA + 0.3, variance=4e-4)
    before, after = _touched().tool, _untouched(_touched(), turned, np.eye(4)).tool
    k = LAB.tool.k_W
    assert_allclose(after.L2_W, se3.so3_exp(0.3 * k) @ before.L2_W, atol=1e-12)
    along = np.cross(k, after.L2_W)
    more = along @ (after.L2_covariance - se3.so3_exp(0.3 * k) @ before.L2_covariance
                    @ se3.so3_exp(-0.3 * k)) @ along / (along @ along) ** 2  # fmt: skip
    assert_allclose(more, 3e-4)
    X_WK = LAB.end_effector().X @ after.X_EK
    tip = (X_WK @ after.X_KT)[:3, 3] - X_WK[:3, 3]
    assert_allclose(tip, -after.L2_W, atol=1e-12)


def test_a_tool_that_is_carried_stays_as_it_was_until_it_is_touched() -> None:
    state, turned = _touched(), replace(_angle(), theta=THETA + 0.3)
    shifted = np.eye(4)
    shifted[:3, 3] = 0.005
    assert _untouched(state, turned, shifted).tool.angle.theta == turned.theta
    carried = np.eye(4)
    carried[:3, :3] = se3.so3_exp(np.array([0.0, 0.02, 0.0]))
    away = _untouched(state, turned, carried)
    assert away.tool is state.tool
    assert _untouched(away, turned, np.eye(4)).tool is state.tool
    assert not _touched().carried


def test_what_an_angle_has_been_unsure_of_is_forgotten_once_it_is_known() -> None:
    state, angle = _touched(), _angle()
    for variance in (4e-4, 1e-4, 9e-4, 1e-4):
        state = _untouched(state, replace(angle, variance=variance), np.eye(4))
    assert_allclose(state.tool.L2_covariance, _touched().tool.L2_covariance, atol=1e-15)
