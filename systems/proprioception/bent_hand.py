"""The bent hand in the world, its errors by how long they last, and what a grasp leaves it free."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.vectors import cross
from crossmodal.systems.port_values import EndEffectorBelief, GraspBelief, GraspType, PoseBelief


@dataclass(kw_only=True)
class FreeMotion:
    """What the grasp leaves free, and how sure that is.

    Attributes:
        projection: (6, 6), the free part of the hand's twist, in H.
        axis: Grasping axis (3,) in H through point (3,), [m].
        doubt: (2,) standard deviation of the share of the hand's turning and of its sliding that
            the body follows.
        looseness: Share of a hinge's turning to expect of the body, 1 sigma: one if it may turn
            about the axis, else the square root of the probability that it may.
        line: Square root (6, 6) of the covariance of axis and point; zero if neither is free.
    """

    projection: Array
    axis: Array
    point: Array
    doubt: Array
    looseness: float
    line: Array


def free_motion(grasp: GraspBelief) -> FreeMotion:
    """Reads the grasp; the likeliest type decides, the others are doubts."""
    held = max(1.0 - grasp.probabilities[GraspType.FAILED], 1e-9)
    slides = grasp.probabilities[GraspType.CYLINDRICAL] / held
    turns = slides + grasp.probabilities[GraspType.REVOLUTE] / held
    free = np.array([grasp.type != GraspType.PERFECT, grasp.type == GraspType.CYLINDRICAL])
    chance = np.clip([turns, slides], 0.0, 1.0)
    doubt = np.sqrt(np.where(free, 1.0 - chance, chance))
    if grasp.type == GraspType.FAILED:
        doubt = np.zeros(2)
    return FreeMotion(
        projection=grasp.free_motion,
        axis=grasp.axis_H,
        point=grasp.p_HA,
        doubt=doubt,
        looseness=1.0 if free[0] else float(np.sqrt(chance[0])),
        line=square_root(grasp.line_covariance) if free[0] else np.zeros((6, 6)),
    )


def square_root(covariance: Array) -> Array:
    """The symmetric square root A (n, n) of a covariance that may be singular, A A = covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def line_sensitivity(free: FreeMotion, tau: Array, turned: float, slides: bool) -> Array:
    """How an error of axis and point (6,) moves the body, in H, against the mean; (6, 6).

    Args:
        tau: The hand's twist (6,).
        turned: How much the body turns about the axis against the hand, [rad].
        slides: Whether it slides too.
    """
    a, p = free.axis, free.point
    A = np.zeros((6, 6))
    A[:3, :3] = turned * np.eye(3) - np.outer(a, tau[:3])
    A[3:, :3] = turned * se3.skew(p) - np.outer(cross(p, a), tau[:3])
    A[3:, 3:] = -turned * se3.skew(a)
    if slides:
        A[3:, :3] -= (a @ (tau[3:] + cross(tau[:3], p))) * np.eye(3)
        A[3:, :3] -= np.outer(a, tau[3:] + cross(tau[:3], p))
        A[3:, 3:] -= np.outer(a, cross(a, tau[:3]))
    return A


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
