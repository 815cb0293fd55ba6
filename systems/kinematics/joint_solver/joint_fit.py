"""How well a type explains the keyframes: chi-square of what is off its path, compiled."""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.in_place import assign
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.maths.tangent_plane import tangent_basis
from crossmodal.systems.kinematics.joint_solver.joint_geometry import (
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
)
from crossmodal.systems.kinematics.joint_solver.joint_models import Models
from crossmodal.systems.kinematics.joint_solver.noise_scale import MEASURED
from crossmodal.systems.kinematics.joint_solver.pose_keyframes import Keyframes, floor_share


@hot
def measured_directions(kf: Keyframes, k: int) -> int:
    """In how many of six directions keyframe k was measured."""
    directions = 0
    for i in range(6):
        directions += 1 if kf.R[k, i, i] < MEASURED else 0
    return directions


@hot
def _square(W: Array, r: Array, along: Array) -> float:
    """r^T W r without its part along a direction (6,), or zero."""
    rr, rs, ss = 0.0, 0.0, 0.0
    for i in range(6):
        for j in range(6):
            rr += r[i] * W[i, j] * r[j]
            rs += r[i] * W[i, j] * along[j]
            ss += along[i] * W[i, j] * along[j]
    return rr - rs * rs / ss if ss > 0.0 else rr


@hot
def off_path(kind: int, m: Models, kf: Keyframes, floor: Array) -> tuple[float, int]:
    """Chi-square of the keyframes' distances from a joint's path, and its degrees of freedom.

    Where along the path a keyframe is, is free. An outlier counts as little as it did in the fit.

    Args:
        kind: `PRISMATIC`, `REVOLUTE`, `SCREW` or `RIGID`.
        m: Models.
        kf: Keyframes.
        floor: Covariance (6, 6) of how far a keyframe may be off, beside its noise; in the place of
            the keyframes' own.
    """
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    Y, a, c, h, q = m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind]
    X, G, J, B = np.empty((4, 4)), np.empty((6, 6)), np.zeros((6, 6)), np.empty((2, 3))
    W, r, along = np.empty((6, 6)), np.empty(6), np.zeros(6)
    tangent_basis(a, B)
    screw_twists(kind, Y, a, c, h, B, G)
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
        cholesky.inverse(L, W, six)
        if kf.open[k] > 0.0:
            inlier = m.inlier[kind, k]
            # The covariance of an outlier is far larger than any floor.
            assign(W, inlier * W + (1.0 - inlier) * kf.W_out[k])
        chi_square += _square(W, r, along)
        measured = measured_directions(kf, k)
        degrees += measured
    return chi_square, degrees - (dimension(kind) - 6 + measured)
