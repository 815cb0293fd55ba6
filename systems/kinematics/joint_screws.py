"""The unit twist of a joint and how uncertain it is; virtual work turns it into a force."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maths import se3
from maths.arrays import Array
from maths.vectors import cross
from systems.port_values import JointModelBelief, JointType


def _prismatic(model: JointModelBelief) -> tuple[Array, Array]:
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = model.axis_covariance
    return np.concatenate([np.zeros(3), model.axis_P]), covariance


def _revolute(model: JointModelBelief) -> tuple[Array, Array]:
    return _screw(replace(model, pitch=0.0, pitch_variance=0.0))


def _screw(model: JointModelBelief) -> tuple[Array, Array]:
    a, p, h = model.axis_P, model.p_PA, model.pitch
    by_axis = np.vstack([np.eye(3), se3.skew(p) + h * np.eye(3)])
    by_point = np.vstack([np.zeros((3, 3)), -se3.skew(a)])
    by_pitch = np.concatenate([np.zeros(3), a])
    covariance = by_axis @ model.axis_covariance @ by_axis.T
    covariance += by_point @ model.p_PA_covariance @ by_point.T
    covariance += model.pitch_variance * np.outer(by_pitch, by_pitch)
    return np.concatenate([a, cross(p, a) + h * a]), covariance


# By type that moves.
SCREWS: dict[JointType, Callable[[JointModelBelief], tuple[Array, Array]]] = {
    JointType.PRISMATIC: _prismatic,
    JointType.REVOLUTE: _revolute,
    JointType.SCREW: _screw,
}


def screw_belief(joint_type: JointType, model: JointModelBelief) -> tuple[Array, Array]:
    """Unit twist S_P (6,) at Po per unit of q, rotation first, and its covariance (6, 6).

    Axis, point and pitch count as independent. The generalised force of a spatial force F_P (6,) at
    Po, torque first, is S_P · F_P: the moment about a hinge's axis, the force along a slide, and of
    a screw the moment and the pitch times the force along its axis.
    """
    return SCREWS[joint_type](model)


def speed_at(S: Array, p: Array) -> float:
    """How fast the point p (3,) moves per unit of q's rate, [1] or [m]: for a hinge the lever."""
    return float(np.linalg.norm(S[3:] + cross(S[:3], p)))


def bracket(V: Array) -> Array:
    """ad_V (6, 6): the Lie bracket of a twist V (6,), rotation first, with another one."""
    omega, v = se3.skew(V[:3]), se3.skew(V[3:])
    return np.block([[omega, np.zeros((3, 3))], [v, omega]])
