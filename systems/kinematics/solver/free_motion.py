"""The evidence of a body that no joint holds, compiled.

Its pose is filtered over the keyframes by several motion models at once: the pose is a random walk,
or the velocity is, or the acceleration, as that of a body that is carried (the nearly constant
velocity and acceleration models of Y. Bar-Shalom, X. Li and T. Kirubarajan, "Estimation with
Applications to Tracking and Navigation", 2001, 6.2), each with several strengths of its process
noise. The mean over these models is the type that wins where no joint explains the motion.

Rotation and position change independently of each other, in F: the position of a body that turns
evenly is not expected to follow a circle.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.keyframes.outliers import inlier_share
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    MEMORY,
    Keyframes,
    floor_share,
)

_SCALES = (1.0, 0.1, 0.01)  # Factors on the largest process noises.


class FreeMotion(NamedTuple):
    """The M motion models of a free body.

    Attributes:
        order: (M,) the derivative of the pose that is a random walk: zero for the pose itself, one
            for its velocity, two for its acceleration.
        noise: (M, 6) process noise of that derivative, [rad^2/s, m^2/s] of the pose, each further
            one per second squared; the first is that of the fastest walk.
        first: (D, 6) variances of the first velocity and acceleration, where there is one.
    """

    order: Ids
    noise: Array
    first: Array


def free_motion(noise: Array, first: Array) -> FreeMotion:
    """All motion models.

    Args:
        noise: (D + 1, 6) largest process noise of the pose and of its D first derivatives.
        first: (D, 6) see `FreeMotion`.
    """
    scaled = np.concatenate([np.outer(_SCALES, row) for row in noise])
    return FreeMotion(np.repeat(np.arange(len(noise)), len(_SCALES)), scaled, first)


@hot
def _rotate(X: Array, R: Array, out: Array) -> None:
    """Writes a covariance (6, 6) of rotation and translation in B as one in F into `out`."""
    T = np.empty((3, 3))
    for a in range(0, 6, 3):
        for b in range(0, 6, 3):
            for i in range(3):
                for j in range(3):
                    T[i, j] = 0.0
                    for k in range(3):
                        T[i, j] += X[i, k] * R[a + k, b + j]
            for i in range(3):
                for j in range(3):
                    s = 0.0
                    for k in range(3):
                        s += T[i, k] * X[j, k]
                    out[a + i, b + j] = s


@hot
def _move(X: Array, xi: Array, share: float) -> None:
    """Turns and moves a pose by a share of a rotation vector and a translation (6,) in F."""
    w0, w1, w2 = share * xi[0], share * xi[1], share * xi[2]
    square = w0 * w0 + w1 * w1 + w2 * w2
    angle = np.sqrt(square)
    s, d = (1.0, 0.5) if angle < 1e-6 else (np.sin(angle) / angle, (1.0 - np.cos(angle)) / square)
    for j in range(3):
        x, y, z = X[0, j], X[1, j], X[2, j]
        u0, u1, u2 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
        X[0, j] += s * u0 + d * (w1 * u2 - w2 * u1)
        X[1, j] += s * u1 + d * (w2 * u0 - w0 * u2)
        X[2, j] += s * u2 + d * (w0 * u1 - w1 * u0)
        X[j, 3] += share * xi[3 + j]


@hot
def _difference(X: Array, Z: Array, e: Array) -> None:
    """Writes rotation and translation from the pose X to Z, in F, into `e` (6,)."""
    pose_difference(X, Z, e)
    x, y, z = e[0], e[1], e[2]
    for i in range(3):
        e[i] = X[i, 0] * x + X[i, 1] * y + X[i, 2] * z
        e[3 + i] = Z[i, 3] - X[i, 3]


@hot
def _integral(dt: float, times: int) -> float:
    """What a constant one becomes in dt [s], integrated so many times."""
    value = 1.0
    for i in range(times):
        value *= dt / (i + 1.0)
    return value


@hot
def _add(A: Array, B: Array, scale: float) -> None:
    """A += scale B, both (6, 6)."""
    for i in range(6):
        for j in range(6):
            A[i, j] += scale * B[i, j]


@hot
def _predict(P: Array, noise: Array, order: int, dt: float) -> None:
    """Covariances (D + 1, D + 1, 6, 6) of the pose and its derivatives, dt [s] later."""
    for a in range(order):
        for c in range(a + 1, order + 1):
            for b in range(order + 1):
                _add(P[a, b], P[c, b], _integral(dt, c - a))
    for b in range(order):
        for c in range(b + 1, order + 1):
            for a in range(order + 1):
                _add(P[a, b], P[a, c], _integral(dt, c - b))
    for a in range(order + 1):
        for b in range(order + 1):
            since = _integral(dt, order - a) * _integral(dt, order - b)
            since *= dt / (2 * order + 1 - a - b)
            for i in range(6):
                P[a, b, i, i] += noise[i] * since


@hot
def _advance(X: Array, v: Array, order: int, dt: float) -> None:
    """Moves a pose by its derivatives (D, 6), and these, dt [s] on."""
    for a in range(order):
        _move(X, v[a], _integral(dt, a + 1))
    for a in range(order):
        for b in range(a + 1, order):
            for i in range(6):
                v[a, i] += _integral(dt, b - a) * v[b, i]


@hot
def _whiten(e: Array, P: Array, R: Array, k: int, L: Array, x: Array) -> float:
    """Factors P + R_k into `L`, writes L^-1 e into `x`; returns its log density.

    Without the constant of all normal densities.
    """
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    for i in range(6):
        x[i] = e[i]
        for j in range(i + 1):
            L[i, j] = P[i, j] + R[k, i, j]
    total = cholesky.factor(L, six)
    cholesky.forward(L, x, six)
    for i in range(6):
        total += x[i] * x[i]
    return -0.5 * total


@hot
def _gain(L: Array, P: Array, x: Array, K: Array, step: Array) -> None:
    """Writes L^-1 P, both (6, 6), into `K`, and its rows weighted by `x` into `step` (6,)."""
    for j in range(6):
        step[j] = 0.0
    for i in range(6):
        for j in range(6):
            K[i, j] = P[i, j]
        for k in range(i):
            scale = L[i, k]
            for j in range(6):
                K[i, j] -= scale * K[k, j]
        scale = 1.0 / L[i, i]
        for j in range(6):
            K[i, j] *= scale
            step[j] += x[i] * K[i, j]


@hot
def _reduce(P: Array, A: Array, B: Array) -> None:
    """P -= A^T B, all (6, 6)."""
    for i in range(6):
        for k in range(6):
            scale = A[k, i]
            for j in range(6):
                P[i, j] -= scale * B[k, j]


@hot
def _blended(R: Array, R_out: Array, k: int, inlier: float, out: Array) -> None:
    """Writes the covariance of a keyframe that is an outlier by a part into `out` (1, 6, 6)."""
    six = int(np.int64(6))
    L, W = np.empty((6, 6)), np.zeros((6, 6))
    for share, covariance in ((inlier, R), (1.0 - inlier, R_out)):
        assign(L, covariance[k])
        cholesky.factor(L, six)
        cholesky.inverse(L, out[0], six)
        for i in range(6):
            for j in range(6):
                W[i, j] += share * out[0, i, j]
    cholesky.factor(W, six)
    cholesky.inverse(W, out[0], six)


@hot
def _filter(
    kf: Keyframes,
    noise: Array,
    first: Array,
    order: int,
    R: Array,
    R_out: Array,
    share: float,
    inlier: Array,
) -> tuple[float, float]:
    """The log evidence of one motion model, without the pending keyframes and with them.

    Args:
        noise: (6,) process noise, see `FreeMotion`.
        first: (D, 6) variances of the first derivatives, of which `order` are used.
        R: (K, 6, 6) covariance of each keyframe, in F.
        R_out: (K, 6, 6) the same if it is an outlier; of undecided ones.
        share: Of outliers.
        inlier: (K,) see `log_evidences`; a result.
    """
    X, v, zero = kf.Z[0].copy(), np.zeros((order, 6)), int(np.int64(0))
    P, K = np.zeros((order + 1, order + 1, 6, 6)), np.empty((order + 1, 6, 6))
    e, x, step, L, blended = np.empty(6), np.empty(6), np.empty(6), np.empty((6, 6)), R[:1].copy()
    assign(P[0, 0], R[0])
    for a in range(order):
        for i in range(6):
            P[a + 1, a + 1, i, i] = first[a, i]
    value = 0.5 * kf.log_det[0]
    before = value
    inlier[0] = 1.0
    for k in range(1, kf.size[0]):
        dt, half = kf.time[k] - kf.time[k - 1], 0.5 * kf.log_det[k]
        _advance(X, v, order, dt)
        _predict(P, noise, order, dt)
        _difference(X, kf.Z[k], e)
        outlier = half + _whiten(e, P[0, 0], R_out, k, L, x) if kf.undecided[k] > 0.0 else -np.inf
        density = half + _whiten(e, P[0, 0], R, k, L, x)
        if kf.undecided[k] > 0.0:
            inlier[k], density = inlier_share(density, outlier, share)
            if inlier[k] < 1.0 - 1e-9:
                _blended(R, R_out, k, inlier[k], blended)
                _whiten(e, P[0, 0], blended, zero, L, x)
        value += density
        if k < kf.size[0] - kf.pending[0]:
            before = value
        for a in range(order, -1, -1):
            _gain(L, P[0, a], x, K[a], step)
            if a > 0:
                for i in range(6):
                    v[a - 1, i] += step[i]
        _move(X, step, 1.0)
        for a in range(order + 1):
            for b in range(a, order + 1):
                _reduce(P[a, b], K[a], K[b])
                if b > a:
                    for i in range(6):
                        for j in range(6):
                            P[b, a, j, i] = P[a, b, i, j]
    return before, value


@hot
def log_evidences(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> Array:
    """The log evidence (2, M) of each motion model, without the pending keyframes and with them.

    Each keyframe's own normaliser is left out.

    Args:
        inlier: (M, K) probability that each undecided keyframe is an inlier, given those before
            it; a result.
    """
    n = kf.size[0]
    R, R_out, W = np.empty((n, 6, 6)), np.empty((n, 6, 6)), np.empty((6, 6))
    for k in range(n):
        assign(W, kf.R[k] + floor_share(kf, k) * kf.floor)
        _rotate(kf.Z[k], W, R[k])
        if kf.undecided[k] > 0.0:
            for i in range(6):
                W[i, i] += outliers[1 + i]
            _rotate(kf.Z[k], W, R_out[k])
    values = np.empty((2, kf.free.size))
    for i in range(kf.free.size):
        values[0, i], values[1, i] = _filter(
            kf,
            motion.noise[i],
            motion.first,
            motion.order[i],
            R,
            R_out,
            outliers[0],
            inlier[i],
        )
    return values


@hot
def explain(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> None:
    """Completes `kf.explained`, and `kf.free` by what averages have hidden since it was last known.

    Args:
        inlier: (K,) see `log_evidences`, of the likeliest model; a result.
    """
    each = np.ones((kf.free.size, inlier.size))
    values = log_evidences(kf, motion, outliers, each)
    if not np.isnan(kf.explained[0]):
        assign(kf.free, np.minimum(np.maximum(kf.explained - values[0], -MEMORY), 0.0))
    assign(kf.explained, values[1] + kf.free)
    kf.pending[0] = 0
    assign(inlier, each[np.argmax(kf.explained)])


@hot
def explain_pending(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> None:
    """Explains what is pending, before keyframes change in a way that would lose it."""
    if kf.pending[0] > 0 and not np.isnan(kf.explained[0]):
        explain(kf, motion, outliers, inlier)


@hot
def free_evidence(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> float:
    """The log evidence of a body that no joint holds; see `explain`."""
    if np.isnan(kf.explained[0]) or kf.pending[0] > 0:
        explain(kf, motion, outliers, inlier)
    top = kf.explained.max()
    return top + np.log(np.exp(kf.explained - top).mean())
