"""The held tool as a link of the arm that holds it."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.flap.flap_geometry import lever, place_error
from crossmodal.systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    UNKNOWN_TOOL,
    EndEffectorBelief,
    FingertipContact,
    FlapAngleBelief,
    HingeBelief,
    ToolBelief,
    displacement_at,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class ToolKinematicsConfig(Ticked):
    """Configuration of `ToolKinematics`."""

    # Rotation of the holder since the last contact from which on the tool is carried elsewhere.
    carried: float = number(0.01, above=0.0, at_most=10.0, unit="rad")


@dataclass(frozen=True, kw_only=True)
class ToolState(Immutable):
    """What is known at one tick.

    Attributes:
        tool: The last tool that was known.
        touched: The tool at the last contact.
        X_WE: Where the holder was then (4, 4); None before.
        carried: Whether it has carried the tool away since.
    """

    tool: ToolBelief = UNKNOWN_TOOL
    touched: ToolBelief = UNKNOWN_TOOL
    X_WE: Array | None = None
    carried: bool = False


def pose(R: Array, p: Array) -> Array:
    """X (4, 4) of a rotation and a position."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def tool_link(
    hinge: HingeBelief,
    angle: FlapAngleBelief,
    contact: FingertipContact,
    end_effector: EndEffectorBelief,
) -> ToolBelief:
    """The tool's links, of a known hinge, a known angle and a sensed contact."""
    arm = lever(hinge, contact)
    k, R_WE, p_WE = hinge.k_W, end_effector.X[:3, :3], end_effector.X[:3, 3]
    at_E = displacement_at(p_WE, hinge.p_WQ)
    L1 = hinge.p_WK - (p_WE - at_E @ hinge.displacements[6:])
    # The nearest point on the axis to a contact that is displaced along it is displaced as far.
    along = -np.outer(k, k) @ displacement_at(contact.p_WC, hinge.p_WQ)
    J = np.hstack([np.eye(3), along, at_E])
    L1_covariance = J @ hinge.joint_covariance[3:, 3:] @ J.T
    L1_covariance = L1_covariance + float(k @ place_error(contact) @ k) * np.outer(k, k)
    L1_covariance = L1_covariance + R_WE @ end_effector.white_covariance[3:6, 3:6] @ R_WE.T
    turn = se3.so3_exp(np.array([0.0, 0.0, angle.theta]))
    x_K = se3.so3_exp(-angle.theta * k) @ arm.u_W / arm.length
    R_WK = np.column_stack([x_K, np.cross(k, x_K), k])
    return ToolBelief(
        hinge=hinge,
        angle=angle,
        L1_W=L1,
        L2_W=-arm.u_W,
        L1_covariance=L1_covariance,
        L2_covariance=arm.covariance,
        X_EK=pose(R_WE.T @ R_WK, R_WE.T @ L1),
        X_KT=pose(turn, turn @ np.array([arm.length, 0.0, 0.0])),
    )


def turned_tool(tool: ToolBelief, angle: FlapAngleBelief) -> ToolBelief:
    """The tool once its flap is turned to another angle and nobody feels where it is.

    Where on the flap it was touched last is as certain as it was, but turns with the flap.
    """
    k = tool.hinge.k_W
    R = se3.so3_exp((angle.theta - tool.angle.theta) * k)
    L2 = R @ tool.L2_W
    along = np.cross(k, L2)
    more = max(0.0, angle.variance - tool.angle.variance)
    turn = se3.so3_exp(np.array([0.0, 0.0, angle.theta]))
    return replace(
        tool,
        angle=angle,
        L2_W=L2,
        L2_covariance=R @ tool.L2_covariance @ R.T + more * np.outer(along, along),
        X_KT=pose(turn, turn @ np.array([np.linalg.norm(L2), 0.0, 0.0])),
    )


def update_tool(
    state: ToolState,
    hinge: HingeBelief,
    angle: FlapAngleBelief,
    contact: FingertipContact,
    end_effector: EndEffectorBelief,
    config: ToolKinematicsConfig,
) -> ToolState:
    """The state after one tick.

    Axis and angle are those of a tool that stands in the world: of one that is carried the last
    tool stays as it was, until it is touched again.
    """
    if not angle.known:
        return state
    if hinge.known and contact.contact.touching:
        tool = tool_link(hinge, angle, contact, end_effector)
        return ToolState(tool=tool, touched=tool, X_WE=end_effector.X)
    if state.X_WE is None or state.carried:
        return state
    turn = se3.so3_log(state.X_WE[:3, :3].T @ end_effector.X[:3, :3])
    if np.linalg.norm(turn) > config.carried:
        return replace(state, carried=True)
    return replace(state, tool=turned_tool(state.touched, angle))


class ToolKinematics(RecursiveFilter):
    """The tool's links: L1 from the end-effector to the hinge, L2 from the contact to the hinge.

    Without a contact the last tool stays, but for its angle and what turns with it. Without a hinge
    or an angle, and while the holder carries it, all of it stays.

    Input ports:
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `flap_angle_estimated`: `FlapAngleBelief` of this tick.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `end_effector_estimated`: `EndEffectorBelief` of the arm that holds the tool; by how much its
      calibration displaces it is part of the hinge's displacements.

    Output ports:
    - `tool_estimated`: `ToolBelief` of this tick.
    - `tool_latest`: the one of the last tick, from the state.

    Frames: W world, E end-effector, K hinge, T contact.

    Source: the paper on visuo-tactile servoing of articulated tools, section III-B (Q. Li et al.).
    """

    def __init__(self, config: ToolKinematicsConfig) -> None:
        super().__init__()
        check(config, "ToolKinematics")
        self._config = config
        self._hinge = self._declare_value_input("hinge_estimated", UNKNOWN_HINGE)
        self._angle = self._declare_value_input("flap_angle_estimated", UNKNOWN_ANGLE)
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._declare_recursion(ToolState(), self._calc_state, config.period)
        self._declare_estimated("tool_estimated", lambda state: state.tool)
        self._declare_latest("tool_latest", lambda state: state.tool)

    def _calc_state(self, context: Context, state: ToolState) -> ToolState:
        return update_tool(
            state,
            self._read(self._hinge, context),
            self._read(self._angle, context),
            self._read(self._contact, context),
            self._read(self._end_effector, context),
            self._config,
        )
