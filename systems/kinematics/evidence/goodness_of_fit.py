"""How well a joint type explains the keyframes, and with what probability it may be reported."""

import math

import numpy as np
import scipy.special

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.evidence.covariance_floor import FLOORS, covariance_floor
from crossmodal.systems.kinematics.keyframes.measurement_noise import (
    MeasurementNoise,
    degrees_of_freedom,
    estimated_scale,
)
from crossmodal.systems.kinematics.keyframes.outliers import squared_residual
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    Keyframes,
    floor_share,
    measured_directions,
    unaveraged,
)
from crossmodal.systems.kinematics.solver.joint_geometry import (
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
)
from crossmodal.systems.kinematics.solver.joint_models import Models


@hot
def off_path(kind: int, m: Models, kf: Keyframes, floor: Array) -> tuple[float, int]:
    """Chi-square of the keyframes' distances from a joint's path, and its degrees of freedom.

    Where along the path a keyframe is, is free. An outlier counts as little as it did in the fit.

    Args:
        kind: `PRISMATIC`, `REVOLUTE`, `SCREW` or `RIGID`.
        floor: Covariance (6, 6) of how far a keyframe may be off, beside its noise; in the place of
            the keyframes' own.
    """
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    Y, a, c, h, q = m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind]
    X, G, J = np.empty((4, 4)), np.empty((6, 6)), np.zeros((6, 6))
    W, r, along, first = np.empty((1, 6, 6)), np.empty(6), np.zeros(6), int(np.int64(0))
    screw_twists(kind, Y, a, c, h, G)
    chi_square, degrees, measured = 0.0, 0, 0
    for k in range(kf.size[0]):
        child_pose(kind, Y, a, c, h, q[k], X)
        pose_difference(X, kf.Z[k], r)
        if kind != RIGID and k > 0:
            jacobian(kind, G, h, q[k], J)
            assign(along, J[0])
            degrees -= 1
        L = kf.R[k] + floor_share(kf, k) * floor
        cholesky.factor(L, six)
        cholesky.inverse(L, W[0], six)
        if kf.undecided[k] > 0.0:
            inlier = m.inlier[kind, k]
            # The covariance of an outlier is far larger than any floor.
            assign(W[0], inlier * W[0] + (1.0 - inlier) * kf.W_out[k])
        chi_square += squared_residual(W, first, r, along)
        measured = measured_directions(kf, k)
        degrees += measured
    return chi_square, degrees - (dimension(kind) - 6 + measured)


_INSIDE = 0.95  # Probability of the bounds.
_TAIL = 0.5 - 0.5 * _INSIDE
_LEAD = 1e-6  # By which the likeliest type is ahead.


def reduced_chi_square(
    kind: int, m: Models, kf: Keyframes, noise: MeasurementNoise
) -> tuple[float, tuple[float, float], int]:
    """Reduced chi-square of the keyframes off a joint's path, its 95 % bounds, and its degrees.

    The noise's scale is an estimate too, so that the bounds are those of an F distribution. NaN for
    a free motion, which has no path to be off, and where there is too little data.
    """
    nothing = math.nan, (math.nan, math.nan), 0
    if kind > RIGID:
        return nothing
    square, degrees = off_path(kind, m, kf, unaveraged(kf))
    if degrees < 1:
        return nothing
    of_noise = degrees_of_freedom(noise)
    low, high = (float(scipy.special.fdtri(degrees, of_noise, p)) for p in (_TAIL, 1.0 - _TAIL))
    return square / degrees, (low, high), degrees


def largest_probability(
    kind: int, m: Models, kf: Keyframes, noise: MeasurementNoise, reported: Array
) -> float:
    """Largest probability of a joint type, by how far the keyframes are off its path.

    No real joint is ideal, but a child that deviates by more than the largest floor is on none. Let
    p be the probability that keyframes are so far off or farther. The type may be certain while p
    is above that of the upper bound; beyond it, its probability is at most the ratio of both.

    Args:
        kind: A type, likely or not.
        reported: Covariance (6, 6) that measurements report.
    """
    if kind > RIGID:
        return 1.0
    largest = covariance_floor(len(FLOORS) - 1, reported, estimated_scale(noise))
    largest[:3, :3] += kf.wander[0] * np.eye(3)
    square, degrees = off_path(kind, m, kf, largest)
    if degrees < 1:
        return 1.0
    p = float(scipy.special.fdtrc(degrees, degrees_of_freedom(noise), square / degrees))
    return min(1.0, p / _TAIL)


@hot
def _normalised(log_p: Array) -> Array:
    p = np.exp(log_p - log_p.max())
    return p / p.sum()


@hot
def reported_probabilities(reported: Array, ranking: Array) -> tuple[Array, int]:
    """Probabilities (n,) of the types that hold for both priors, and the likeliest type.

    Where the priors by which types are ranked are less certain of the likeliest one, theirs count.
    Where another one would lead by the others, as much of the ranking is mixed in as it takes.

    Args:
        reported: Log probabilities (n,), not normalised, of one who expects no type.
        ranking: The same from the priors by which types are ranked.
    """
    p, ranked = _normalised(reported), _normalised(ranking)
    likeliest, share = int(np.argmax(ranked)), 0.0
    if ranked[likeliest] < p[likeliest]:
        return ranked, likeliest
    for k in range(p.size):
        behind = p[k] + _LEAD - p[likeliest]
        if k != likeliest and behind > 0.0:
            ahead = ranked[likeliest] - ranked[k]
            share = max(share, behind / max(ahead + behind, _LEAD))
    return (1.0 - share) * p + share * ranked, likeliest
