"""Keyframes linearised about one joint whose strays are a cosine series, compiled.

The strays are a short series over the configuration, in B, with unknown normal coefficients; along
the path nothing strays. What the keyframes say of theta and of every q is that of
`joint_linearisation` once the coefficients are marginalised.
"""

from typing import NamedTuple

import numpy as np

from maths import cholesky
from maths.arrays import Array
from maths.compiled import hot
from maths.se3_in_place import relative_log
from maths.tangent_plane import tangent_basis
from systems.kinematics.joint_solver.joint_geometry import (
    BENT_SLIDE,
    PARAMETERS,
    PRISMATIC,
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
)
from systems.kinematics.joint_solver.joint_linearisation import Linear
from systems.kinematics.joint_solver.joint_models import Models
from systems.kinematics.joint_solver.pose_keyframes import Keyframes, floor_share

_WAVES = 4  # Of the series.


class Series(NamedTuple):
    """What the keyframes say of the coefficients of C waves in six directions, theta known or not.

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
def _times(W: Array, x: Array, out: Array) -> None:
    for i in range(6):
        s = 0.0
        for j in range(6):
            s += W[i, j] * x[j]
        out[i] = s


@hot
def _add_to_series(
    n: int, share: float, wave: Array, D: Array, r: Array, W: Array, to: Series
) -> None:
    """Adds one keyframe of residual r (6,) and derivatives D (n, 6), weighted by W (6, 6)."""
    x = np.empty(6)
    _times(W, r, x)
    for i in range(_WAVES):
        a = share * wave[i]
        for d in range(6):
            to.vector[6 * i + d] += a * x[d]
        for j in range(i + 1):
            b = a * share * wave[j]
            for d in range(6):
                for e in range(6):
                    to.information[6 * i + d, 6 * j + e] += b * W[d, e]
    for p in range(n):
        _times(W, D[p], x)
        for i in range(_WAVES):
            a = share * wave[i]
            for d in range(6):
                to.coupling[p, 6 * i + d] += a * x[d]


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

    Where it is smooth, the series' coefficients are zero for `lin`, and what the keyframes say of
    them is added to `series`. `lin.value` has the normalisers.
    """
    six, n, size = int(np.int64(6)), dimension(kind), kf.size[0]
    of = PRISMATIC if kind == BENT_SLIDE else kind
    Y, a, c, pitch, q = m.Y[of], m.a[of], m.c[of], m.pitch[of], m.q[of]
    X, G, B, J = np.empty((4, 4)), np.empty((6, 6)), np.empty((2, 3)), np.empty((6, 6))
    D, r, Wr, WJ = np.zeros((n, 6)), np.empty(6), np.empty(6), np.empty(6)
    W, A, waves = np.empty((6, 6)), np.empty((6, 6)), _waves(q, size)
    tangent_basis(a, B)
    screw_twists(kind, Y, a, c, pitch, B, G)
    for i in range(6):
        D[i, i] = 1.0
    for k in range(size):
        child_pose(kind, Y, a, c, pitch, q[k], X)
        relative_log(X, kf.Z[k], r)
        A[:] = kf.R[k] + floor_share(kf, k) * rough
        log_det = cholesky.factor(A, six)
        cholesky.inverse(A, W, six)
        if kf.open[k] > 0.0:
            inlier = m.inlier[of, k]
            W[:] = inlier * W + (1.0 - inlier) * kf.W_out[k]
            log_det *= inlier
        lin.value[0] -= 0.5 * log_det
        if kind != RIGID:
            jacobian(kind, G, pitch, q[k], J)
            for i in range(n - 6):
                D[6 + i] = J[1 + i]
            if k > 0:  # What speaks about q; what is left of W speaks about theta and the strays.
                _times(W, J[0], WJ)
                alpha, g = 0.0, 0.0
                for i in range(6):
                    alpha += J[0, i] * WJ[i]
                    g += r[i] * WJ[i]
                lin.alpha[k], lin.g[k] = alpha, g
                for i in range(n):
                    lin.beta[k, i] = 0.0
                    for j in range(6):
                        lin.beta[k, i] += D[i, j] * WJ[j]
                for i in range(6):
                    for j in range(6):
                        W[i, j] -= WJ[i] * WJ[j] / alpha
            if is_smooth:
                _add_to_series(n, floor_share(kf, k), waves[k], D, r, W, series)
        _times(W, r, Wr)
        for j in range(6):
            lin.value[0] -= 0.5 * r[j] * Wr[j]
        for i in range(n):
            for j in range(6):
                lin.vector[i] += D[i, j] * Wr[j]
            _times(W, D[i], WJ)
            for p in range(i + 1):
                for j in range(6):
                    lin.information[i, p] += WJ[j] * D[p, j]


@hot
def marginalise(n: int, strays: Array, series: Series, lin: Linear) -> None:
    """Takes the coefficients out; `strays` (6, 6) is the covariance of the series' largest wave."""
    size = 6 * _WAVES
    S, s, columns = series.information, series.vector, series.coupling
    for i in range(_WAVES):
        for d in range(6):
            variance = strays[d, d] / (i + 1.0) ** 4
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
