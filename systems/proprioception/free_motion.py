"""What a grasp leaves free of the hand's motion, and how sure that is."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import cross
from crossmodal.systems.port_values import GraspBelief, GraspType


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
        free: Axis a and point p.
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
