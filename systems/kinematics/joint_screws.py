"""The unit twist of a joint and how uncertain it is; virtual work turns it into a force."""

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
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
