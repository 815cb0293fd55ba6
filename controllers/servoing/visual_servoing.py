"""Turns the fingertip with the flap as it is seen, and moves its contact on."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.sequence import known_belief
from crossmodal.controllers.servoing.twists import from_contact
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.maths.vectors import cross

# Cosine of the angle between finger and hinge from which on they are taken to go the same way.
_ABOUT_PARALLEL = 0.5


@dataclass(kw_only=True)
class VisualServoingConfig:
    """Gains and limits.

    Attributes:
        typical_distance: Of the hinge from the contact, expected while none is known, [m]. It is no
            field: the station hands over what the estimators expect.
    """

    typical_distance = 0.085
    # Gain of the roll towards the flap.
    roll_gain: float = number(1.0, at_least=0.0, at_most=100.0, unit="1/s")
    # Gain of the finger's alignment with the hinge.
    align_gain: float = number(0.5, at_least=0.0, at_most=100.0, unit="1/s")
    # Largest rate of turning by what is seen.
    turn_limit: float = number(0.2, above=0.0, at_most=10.0, unit="rad/s")
    # Standard deviation of a direction above which it is not used.
    uncertainty: float = number(0.35, above=0.0, at_most=3.2, unit="rad")
    # Standard deviation of that distance among tools.
    distance_spread: float = number(0.02, above=0.0, at_most=10.0, unit="m")


def towards_hinge(n_f: Array, z_S: Array) -> Array:
    """The direction (3,) along the flap from its free edge to the hinge.

    Args:
        n_f: Normal of the flap (3,), on the side to which it turns.
        z_S: Along the finger (3,), about parallel to the hinge with the sense of the turn.
    """
    target = cross(z_S, n_f)
    return np.asarray(target / np.linalg.norm(target))


def roll_angle(y_S: Array, z_S: Array, n_f: Array) -> float:
    """Angle about z_S from y_S to the flap's direction towards the hinge, [rad].

    It is zero where y_S . n_f = 0. The product n x n_f of the paper, taken literally, is zero only
    where both are parallel.
    """
    target = towards_hinge(n_f, z_S)
    return float(np.arctan2(cross(y_S, target) @ z_S, y_S @ target))


def seen_misalignment(R_WS: Array, plane: Any) -> Array:
    """The rotation vector (3,) in S that turns a fingertip to a flap as it is seen, [rad].

    Then x_S is the flap's normal and z_S lies along its free edge. Where the edge is not seen, it
    is the least rotation that turns x_S to the normal.

    Args:
        R_WS: Orientation of the fingertip (3, 3).
        plane: `FlapPlane` that is seen.
    """
    n_S = R_WS.T @ plane.n_W
    edge_S = R_WS.T @ plane.edge_W
    if not np.isfinite(edge_S).all():
        axis = np.array([0.0, -n_S[2], n_S[1]])  # x cross n
        sine = float(np.linalg.norm(axis))
        return axis * (float(np.arctan2(sine, n_S[0])) / max(sine, 1e-9))
    z_S = edge_S - n_S * (n_S @ edge_S)
    z_S /= np.linalg.norm(z_S)
    return np.asarray(se3.so3_log(np.column_stack([n_S, cross(z_S, n_S), z_S])))


def approaching_twist(
    X_WS: Array, plane: Any, reach: float, projector: Array, config: VisualServoingConfig
) -> Array:
    """V_WS_S (6,) that turns a finger to a flap that it has not touched yet.

    It turns about the place of the edge at which the pad points, or about the pad where the edge is
    not seen.

    Args:
        X_WS: Pose of the fingertip (4, 4).
        plane: `FlapPlane` that is seen.
        reach: Of the pad from the fingertip's origin, [m].
        projector: Diagonal (6,) of P_vis.
    """
    w_S = config.roll_gain * seen_misalignment(X_WS[:3, :3], plane)
    V = np.concatenate([np.clip(w_S, -config.turn_limit, config.turn_limit), np.zeros(3)])
    if np.isfinite(plane.edge_W).all():
        y_W = X_WS[:3, 1]
        across = y_W - plane.edge_W * (plane.edge_W @ y_W)
        reach = float((plane.p_WG - X_WS[:3, 3]) @ across / (across @ across))
    return from_contact(V * projector, np.array([0.0, reach, 0.0]))


def hinge_distance(p_WC: Array, hinge: Any) -> tuple[float, float]:
    """Distance |L2| of a point (3,) from the axis of a `HingeBelief`, and its standard deviation.

    Both in [m].
    """
    k = hinge.k_W
    across = p_WC - hinge.p_WK
    across = across - k * (k @ across)
    distance = float(np.linalg.norm(across))
    if not distance > 0.0:
        return distance, np.inf
    r = across / distance
    return distance, float(np.sqrt(max(r @ hinge.covariance[3:, 3:] @ r, 0.0)))


def fused_distance(p_WC: Array, hinge: Any, config: VisualServoingConfig) -> float:
    """The hinge's distance from the contact, [m]: what is seen and what is typical, weighted."""
    distance, sigma = hinge_distance(p_WC, hinge)
    share = 1.0 / (1.0 + (sigma / config.distance_spread) ** 2)
    return share * distance + (1.0 - share) * config.typical_distance


class VisualServoing(LeafSystem):
    """Feeds the contact along x_S, turns the fingertip with the flap and aligns it with the hinge.

    w = k_roll z_S angle(y_S, target) + k_align z_S x k + z_S v / |L2|, with the target
    along the flap towards the hinge and |L2| the hinge's distance from the contact. Its velocity
    along z_S is that with which the contact, by all that moves it, stays across the hinge, k . v =
    0: else it would slide along the edge. What is not known is left out.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `contact_latest`: `TactileContact`.
    - `feed_forward`: (1,) speed of the contact along x_S, [m/s].
    - `tactile_twist_desired`: (6,) V_WS_S of touch, to whose slide along x_S the arc belongs, too.
    - `visual_projector`: (6,) diagonal of P_vis, in the order of a twist: w_x, w_y, w_z, v_x, v_y,
      v_z.
    - `flap_angle_latest`: `FlapAngleBelief`. May stay unconnected.
    - `hinge_latest`: `HingeBelief`. May stay unconnected.
    - `flap_plane_latest`: `FlapPlane`, to which the finger turns before it touches. May stay
      unconnected.

    Output ports:
    - `visual_twist_desired`: (6,) V_WS_S, [rad/s, m/s]; without a contact it is zero, but for the
      turn to a flap that is seen and was never touched.
    - `misalignment_seen`: (1,) angle by which it is still to turn so, [rad]; zero where there is no
      such flap.

    Frames: W world, S fingertip, C contact.

    Source: as `TactileServoing`.

    Args:
        arm: The arm's own model, its end-effector the fingertip S.
        reach: Of the pad from the fingertip's origin, along y_S, [m].

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(self, config: VisualServoingConfig, arm: ArmModel, reach: float) -> None:
        super().__init__()
        check(config, "VisualServoing")
        self._config, self._arm, self._reach = config, arm, reach
        self._joints = self.DeclareVectorInputPort("joint_state_measured", 2 * arm.num_joints)
        self._contact = self.DeclareAbstractInputPort("contact_latest", Value[object]())
        self._feed = self.DeclareVectorInputPort("feed_forward", 1)
        self._tactile = self.DeclareVectorInputPort("tactile_twist_desired", 6)
        self._projector = self.DeclareVectorInputPort("visual_projector", 6)
        self._angle = self.DeclareAbstractInputPort("flap_angle_latest", Value[object]())
        self._hinge = self.DeclareAbstractInputPort("hinge_latest", Value[object]())
        self._plane = self.DeclareAbstractInputPort("flap_plane_latest", Value[object]())
        self.DeclareVectorOutputPort("visual_twist_desired", 6, self._calc_twist)
        self.DeclareVectorOutputPort(
            "misalignment_seen",
            1,
            self._calc_misalignment,
            {port.ticket() for port in (self._joints, self._contact, self._angle, self._plane)},
        )

    def _untouched(self, context: Context) -> Any:
        """The flap's plane where that is seen and was never touched, else None."""
        contact: Any = self._contact.Eval(context)
        plane: Any = self._plane.Eval(context) if self._plane.HasValue(context) else None
        if contact.touching or known_belief(self._angle, context) is not None:
            return None
        return plane if plane is not None and plane.seen else None

    def _X_WS(self, context: Context) -> Array:
        return self._arm.Evaluate(np.asarray(self._joints.Eval(context))).X_WE

    def _calc_misalignment(self, context: Context, output: BasicVector) -> None:
        plane, left = self._untouched(context), np.zeros(3)
        if plane is not None:
            left = seen_misalignment(self._X_WS(context)[:3, :3], plane)
        output.SetFromVector([float(np.linalg.norm(left))])

    def _calc_twist(self, context: Context, output: BasicVector) -> None:
        contact: Any = self._contact.Eval(context)
        X_WS = self._X_WS(context)
        projector = np.asarray(self._projector.Eval(context))
        if not contact.touching:
            plane = self._untouched(context)
            output.SetFromVector(
                np.zeros(6)
                if plane is None
                else approaching_twist(X_WS, plane, self._reach, projector, self._config)
            )
            return
        angle, hinge = (known_belief(port, context) for port in (self._angle, self._hinge))
        feed = float(self._feed.Eval(context)[0])
        V_tactile = from_contact(np.asarray(self._tactile.Eval(context)), -contact.p_SC)
        V_WC_S = servoing_twist(X_WS, contact.p_SC, feed, V_tactile[3:], angle, hinge, self._config)
        V_WC_S *= projector
        output.SetFromVector(from_contact(V_WC_S, contact.p_SC))


def servoing_twist(
    X_WS: Array,
    p_SC: Array,
    feed: float,
    v_tactile: Array,
    angle: Any,
    hinge: Any,
    config: VisualServoingConfig,
) -> Array:
    """V_WC_S (6,) of `VisualServoing`, before the projector.

    Args:
        X_WS: Pose of the fingertip (4, 4).
        p_SC: The contact (3,), [m].
        feed: Its speed along x_S, [m/s].
        v_tactile: Velocity (3,) of the contact that touch asks for, in S, [m/s].
        angle: `FlapAngleBelief`; None if unknown.
        hinge: `HingeBelief`; None if unknown.
    """
    R_WS = X_WS[:3, :3]
    y_S, z_S = np.ascontiguousarray(R_WS.T)[1:]
    w_W, distance, along = np.zeros(3), config.typical_distance, 0.0
    v_x = feed + float(v_tactile[0])
    if angle is not None and np.trace(angle.n_covariance) < config.uncertainty**2:
        w_W = config.roll_gain * roll_angle(y_S, z_S, angle.n_W) * z_S
    if hinge is not None:
        if np.trace(hinge.covariance[:3, :3]) < config.uncertainty**2:
            w_W = w_W + config.align_gain * cross(z_S, hinge.k_W)
            k_x, k_y, k_z = np.ascontiguousarray(R_WS.T) @ hinge.k_W
            if k_z > _ABOUT_PARALLEL:
                along = -(k_x * v_x + k_y * float(v_tactile[1])) / k_z
        distance = fused_distance(X_WS[:3, 3] + R_WS @ p_SC, hinge, config)
    w_S = np.clip(R_WS.T @ w_W, -config.turn_limit, config.turn_limit)
    arc = np.array([0.0, 0.0, v_x / distance])
    return np.concatenate([w_S + arc, [feed, 0.0, along]])
