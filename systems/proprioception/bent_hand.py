"""The bent hand in the world, with its errors sorted by how long they last."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.in_place import assign
from crossmodal.maths.vectors import cross
from crossmodal.systems.port_values import EndEffectorBelief, PoseBelief


@dataclass(kw_only=True)
class BentHand:
    """Pose of the bent hand, X_WH,true = X_WH exp(J c + L n).

    Attributes:
        X_WH: (4, 4).
        bias_jacobian: J (6, m), error in H per unit of each constant of the episode, c ~ N(0, I).
        noise_square_root: L (6, 6), error in H per unit of n ~ N(0, I), from the bending and the
            encoders' noise; n is a Gauss-Markov process.
    """

    X_WH: Array
    bias_jacobian: Array
    noise_square_root: Array


def bent_hand(end_effector: EndEffectorBelief, bending: PoseBelief) -> BentHand:
    """X_WH = X_WE X_EH and its errors, moved into H."""
    Ad = se3.adjoint(se3.inverse(bending.X))
    white = end_effector.white_covariance[:6, :6]
    covariance = Ad @ white @ Ad.T + bending.covariance + 1e-14 * np.eye(6)
    return BentHand(
        X_WH=end_effector.X @ bending.X,
        bias_jacobian=Ad @ end_effector.bias_jacobian,
        noise_square_root=np.asarray(np.linalg.cholesky(covariance), dtype=float),
    )


@hot
def screw(axis: Array, point: Array) -> Array:
    """Unit twist (6,) of a rotation about the line along `axis` (3,) through `point` (3,)."""
    twist = np.empty(6)
    assign(twist[:3], axis)
    assign(twist[3:], cross(point, axis))
    return twist


def free_rotation(axis: Array, point: Array) -> Array:
    """Projection (6, 6) of a twist at the origin onto rotation about a line.

    It takes all of the twist's rotation along the line and leaves how the line's points move.
    """
    return np.outer(screw(axis, point), np.concatenate([axis, np.zeros(3)]))


def free_sliding(axis: Array, point: Array) -> Array:
    """Projection (6, 6) of a twist at the origin onto sliding along a line.

    The velocity along the line is that of its points: v + omega x point.
    """
    along = np.concatenate([cross(point, axis), axis])
    return np.outer(np.concatenate([np.zeros(3), axis]), along)
