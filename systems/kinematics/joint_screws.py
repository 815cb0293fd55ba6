"""The unit twist of a joint, how uncertain it is, and how it is seen from the hand that moves it.

Virtual work turns the twist into a force.
"""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.vectors import cross
from crossmodal.systems.port_values import JointModelBelief, JointType


def screw(joint_type: JointType, model: JointModelBelief) -> Array:
    """Unit twist S_P (6,) at Po of the child per unit of q, in the parent's frame P."""
    if joint_type == JointType.PRISMATIC:
        return np.concatenate([np.zeros(3), model.axis_P])
    climb = model.pitch * model.axis_P if joint_type == JointType.SCREW else np.zeros(3)
    return np.concatenate([model.axis_P, cross(model.p_PA, model.axis_P) + climb])


def screw_belief(joint_type: JointType, model: JointModelBelief) -> tuple[Array, Array]:
    """The `screw`, and its covariance (6, 6).

    Axis, point and pitch count as independent. The generalised force of a spatial force F_P (6,) at
    Po, torque first, is S_P · F_P: the moment about a hinge's axis, the force along a slide, and of
    a screw the moment and the pitch times the force along its axis.
    """
    S, covariance = screw(joint_type, model), np.zeros((6, 6))
    if joint_type == JointType.PRISMATIC:
        covariance[3:, 3:] = model.axis_covariance
        return S, covariance
    has_pitch = joint_type == JointType.SCREW
    pitch, variance = (model.pitch, model.pitch_variance) if has_pitch else (0.0, 0.0)
    by_axis = np.vstack([np.eye(3), se3.skew(model.p_PA) + pitch * np.eye(3)])
    by_point = np.vstack([np.zeros((3, 3)), -se3.skew(model.axis_P)])
    by_pitch = np.concatenate([np.zeros(3), model.axis_P])
    covariance += by_axis @ model.axis_covariance @ by_axis.T
    covariance += by_point @ model.p_PA_covariance @ by_point.T
    covariance += variance * np.outer(by_pitch, by_pitch)
    return S, covariance


def speed_at(S: Array, p: Array) -> float:
    """How fast the point p (3,) moves per unit of q's rate, [1] or [m]: for a hinge the lever."""
    return float(np.linalg.norm(S[3:] + cross(S[:3], p)))


def bracket(V: Array) -> Array:
    """ad_V (6, 6): the Lie bracket of a twist V (6,), rotation first, with another one."""
    omega, v = se3.skew(V[:3]), se3.skew(V[3:])
    return np.block([[omega, np.zeros((3, 3))], [v, omega]])


@dataclass(frozen=True, kw_only=True)
class HandForce(Immutable):
    """What the hand does to the body that it holds.

    Attributes:
        F_P: Spatial force (6,) on the body at Po, torque [N m] first, expressed in P.
        X_PE: Where the hand is (4, 4).
        pose_jacobian: (6, m) constant error of X_PE, in E, per unit of what it comes from.
        zero_covariance: (6, 6) of the constant error of F_P.
        down_P: Unit vector (3,) of gravity in P.
    """

    F_P: Array
    X_PE: Array
    pose_jacobian: Array = field(default_factory=lambda: np.zeros((6, 0)))
    zero_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    down_P: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))


def hand_screw_covariance(S: Array, hand: HandForce) -> Array:
    """How uncertain a screw (6,) is as the hand sees it, which may be elsewhere: (6, 6), in P.

    With X_PE exp(xi) in place of X_PE, S · F_P is that of the twist S + Ad(X_PE) [S_E] xi.
    """
    to_P = se3.adjoint(hand.X_PE)
    S_E = se3.adjoint(se3.inverse(hand.X_PE)) @ S
    B = to_P @ bracket(S_E) @ hand.pose_jacobian
    return np.asarray(B @ B.T)
