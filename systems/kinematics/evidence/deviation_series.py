"""Keyframes linearised about a joint from whose path the child deviates smoothly, compiled.

The deviations are a short cosine series over the configuration, in B, with unknown normal
coefficients; there is none along the path. Once the coefficients are marginalised, the keyframes'
information about theta and every q has the form of `joint_linearisation`.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes, floor_share
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
    PARAMETERS,
    PRISMATIC,
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    Linear,
    add_keyframe,
    weigh,
)
from crossmodal.systems.kinematics.solver.joint_models import Models

_WAVES = 4  # Number of waves of the series.


class Series(NamedTuple):
    """Information of the keyframes about the coefficients of C waves in six directions.

    Attributes:
        information: (6 C, 6 C), lower triangle.
        vector: (6 C,) its information vector.
        coupling: (N, 6 C) with theta.
    """

    information: Array
    vector: Array
    coupling: Array


@hot
def new_series() -> Series:
    size = 6 * _WAVES
    return Series(np.zeros((size, size)), np.zeros(size), np.zeros((PARAMETERS, size)))


@hot
def _waves(q: Array, size: int) -> Array:
    """The waves (K, C) at each configuration (K,), of which `size` are in use."""
    low, high = q[:size].min(), q[:size].max()
    out = np.empty((size, _WAVES))
    for k in range(size):
        place = (q[k] - low) / (high - low) if high > low else 0.0
        for i in range(_WAVES):
            out[k, i] = np.cos((i + 1) * np.pi * place)
    return out


@hot
def _add_to_series(extra: int, share: float, wave: Array, W: Array, WJ: Array, to: Series) -> None:
    """Adds one keyframe, weighted by W (1, 6, 6), to the series.

    The rows of WJ from 1 on are the derivatives by the parameters of the screw and the residual,
    weighted; the derivatives by the child's pose are one.
    """
    for i in range(_WAVES):
        a = share * wave[i]
        for d in range(6):
            to.vector[6 * i + d] += a * WJ[1 + extra, d]
            for p in range(6):
                to.coupling[p, 6 * i + d] += a * W[0, p, d]
            for p in range(extra):
                to.coupling[6 + p, 6 * i + d] += a * WJ[1 + p, d]
        for j in range(i + 1):
            b = a * share * wave[j]
            for d in range(6):
                for e in range(6):
                    to.information[6 * i + d, 6 * j + e] += b * W[0, d, e]


@hot
def add_keyframes(
    kind: int,
    m: Models,
    kf: Keyframes,
    rough: Array,
    is_smooth: bool,
    lin: Linear,
    series: Series,
) -> None:
    """Adds all keyframes, each with an independent error of the covariance `rough` (6, 6) besides.

    Where deviations are smooth, `lin` is for coefficients of zero, and the information about these
    is added to `series`. `lin.value` has the normalisers.
    """
    six, first, extra, size = int(np.int64(6)), int(np.int64(0)), dimension(kind) - 6, kf.size[0]
    rows = 2 + extra if kind != RIGID else 1
    of = PRISMATIC if kind == BENT_SLIDE else kind
    Y, a, c, pitch, q = m.Y[of], m.a[of], m.c[of], m.pitch[of], m.q[of]
    X, G, A = np.empty((4, 4)), np.empty((6, 6)), np.empty((6, 6))
    J, WJ, W, waves = np.empty((7, 6)), np.empty((7, 6)), np.empty((1, 6, 6)), _waves(q, size)
    r = J[rows - 1]
    screw_twists(kind, Y, a, c, pitch, G)
    for k in range(size):
        child_pose(kind, Y, a, c, pitch, q[k], X)
        pose_difference(X, kf.Z[k], r)
        share = floor_share(kf, k)
        assign(A, kf.R[k] + share * rough)
        log_det = cholesky.factor(A, six)
        cholesky.inverse(A, W[0], six)
        if kf.undecided[k] > 0.0:
            inlier = m.inlier[of, k]
            assign(W[0], inlier * W[0] + (1.0 - inlier) * kf.W_out[k])
            log_det *= inlier
        if kind != RIGID:
            jacobian(kind, G, pitch, q[k], J)
        square, gain = add_keyframe(k, rows - 2, kind != RIGID and k > 0, W, first, J, WJ, lin)
        lin.value[0] -= 0.5 * (square + log_det)
        lin.value[0] += gain
        if is_smooth and k > 0:
            # Only what is not information about q is about a deviation.
            for i in range(6):
                for j in range(6):
                    W[0, i, j] -= WJ[0, i] * WJ[0, j] / lin.alpha[k]
            weigh(W, first, rows, J, WJ)
        if is_smooth:
            _add_to_series(extra, share, waves[k], W, WJ, series)


@hot
def marginalise(n: int, deviations: Array, series: Series, lin: Linear) -> None:
    """Takes the coefficients out; `deviations` (6, 6) is the covariance of the first wave."""
    size = 6 * _WAVES
    S, s, columns = series.information, series.vector, series.coupling
    for i in range(_WAVES):
        for d in range(6):
            variance = deviations[d, d] / (i + 1.0) ** 4
            S[6 * i + d, 6 * i + d] += 1.0 / variance
            lin.value[0] -= 0.5 * np.log(variance)
    lin.value[0] -= 0.5 * cholesky.factor(S, size)
    cholesky.forward(S, s, size)
    for j in range(size):
        lin.value[0] += 0.5 * s[j] ** 2
    for i in range(n):
        cholesky.forward(S, columns[i], size)
        for j in range(size):
            lin.vector[i] -= columns[i, j] * s[j]
        for p in range(i + 1):
            for j in range(size):
                lin.information[i, p] -= columns[i, j] * columns[p, j]
