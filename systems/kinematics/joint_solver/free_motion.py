"""The evidence of a body that no joint holds, compiled.

Its pose is filtered over the keyframes in several ways at once: the pose is a random walk, or its
velocity is, as of a body that is carried (the nearly constant velocity model of Y. Bar-Shalom,
X. Li and T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 6.2),
either with several strengths of its process noise. The mean over all ways is the type that wins
where no joint explains the motion.

Rotation and position change independently of each other, in F: of a body that turns evenly nobody
expects a circle.
"""

from typing import NamedTuple

import numpy as np

from maths import cholesky
from maths.arrays import Array
from maths.compiled import hot
from maths.se3_in_place import relative_log
from systems.kinematics.joint_solver.outliers import blend, inlier_share
from systems.kinematics.joint_solver.pose_keyframes import FREE_WAYS, Keyframes

_SCALES = (1.0, 0.1, 0.01)  # Of the process noise: of a walk, and of a velocity.
assert 2 * len(_SCALES) == FREE_WAYS


class FreeMotion(NamedTuple):
    """The ways in which a free body moves.

    Attributes:
        has_velocity: (M,) one where its velocity is nearly constant, zero where its pose walks.
        noise: (M, 6) process noise, of the walk [rad^2/s, m^2/s] or the velocity
            [rad^2/s^3, m^2/s^3]; the first is that of the fastest walk.
        velocity: (6,) variances of the first velocity, where it has one, [rad^2/s^2, m^2/s^2].
    """

    has_velocity: Array
    noise: Array
    velocity: Array


def free_motion(walk: Array, velocity: Array, acceleration: Array) -> FreeMotion:
    """All ways of moving, from the (6,) largest process noises of pose and velocity."""
    noise = np.concatenate([np.outer(_SCALES, walk), np.outer(_SCALES, acceleration)])
    return FreeMotion(np.repeat([0.0, 1.0], len(_SCALES)), noise, velocity)


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
    """Writes by what the pose Z is turned and moved from X, in F, into `e` (6,)."""
    relative_log(X, Z, e)
    x, y, z = e[0], e[1], e[2]
    for i in range(3):
        e[i] = X[i, 0] * x + X[i, 1] * y + X[i, 2] * z
        e[3 + i] = Z[i, 3] - X[i, 3]


@hot
def _predict(n: int, X: Array, v: Array, P: Array, noise: Array, dt: float) -> None:
    """Pose, velocity and covariance (n, n) a time dt [s] later, in place; n is 6 for a walk."""
    if n == 6:
        for i in range(6):
            P[i, i] += noise[i] * dt
        return
    _move(X, v, dt)
    for i in range(6):
        for j in range(12):
            P[i, j] += dt * P[6 + i, j]
    for i in range(12):
        for j in range(6):
            P[i, j] += dt * P[i, 6 + j]
    for i in range(6):
        S = noise[i] * dt
        P[i, i] += S * dt * dt / 3.0
        P[i, 6 + i] += S * dt / 2.0
        P[6 + i, i] += S * dt / 2.0
        P[6 + i, 6 + i] += S


@hot
def _whiten(e: Array, P: Array, R: Array, L: Array, x: Array) -> float:
    """Factors P + R into `L`, writes L^-1 e into `x`; returns its log density.

    Without the constant of all normal densities.
    """
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    for i in range(6):
        x[i] = e[i]
        for j in range(i + 1):
            L[i, j] = P[i, j] + R[i, j]
    total = cholesky.factor(L, six)
    cholesky.forward(L, x, six)
    for i in range(6):
        total += x[i] * x[i]
    return -0.5 * total


@hot
def _correct(
    n: int, X: Array, v: Array, P: Array, L: Array, x: Array, K: Array, step: Array
) -> None:
    """Kalman update from the factored covariance `L` and the whitened innovation `x`, in place.

    `K` (6, 12) is L^-1 times the first rows of P, a row at once, and `step` (12,) the correction:
    both are overwritten.
    """
    for j in range(n):
        step[j] = 0.0
    for i in range(6):
        for j in range(n):
            K[i, j] = P[i, j]
        for k in range(i):
            for j in range(n):
                K[i, j] -= L[i, k] * K[k, j]
        inverse = 1.0 / L[i, i]
        for j in range(n):
            K[i, j] *= inverse
            step[j] += x[i] * K[i, j]
    for k in range(6):
        for i in range(n):
            for j in range(n):
                P[i, j] -= K[k, i] * K[k, j]
    _move(X, step, 1.0)
    for i in range(6, n):
        v[i - 6] += step[i]


@hot
def log_evidences(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> Array:
    """The log evidence (2, M) of each way of moving, without the newest keyframe and with it.

    Each keyframe's own normaliser is left out.

    Args:
        kf: Keyframes.
        motion: See `FreeMotion`.
        outliers: See `Priors`.
        inlier: (M, K) probability that each open keyframe is none, given those before it; a result.
    """
    six, ways = int(np.int64(6)), kf.free.size
    values = np.full((2, ways), 0.5 * kf.log_det[0])
    X, v, P = np.empty((ways, 4, 4)), np.zeros((ways, 6)), np.zeros((ways, 12, 12))
    e, x, step, K, L = np.empty(6), np.empty(6), np.empty(12), np.empty((6, 12)), np.empty((6, 6))
    W, R, R_out = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for way in range(ways):
        X[way] = kf.Z[0]
        _rotate(kf.Z[0], kf.R[0], P[way])
        for i in range(6):
            P[way, 6 + i, 6 + i] = motion.velocity[i]
    inlier[:, 0] = 1.0
    for k in range(1, kf.size[0]):
        dt, half = kf.time[k] - kf.time[k - 1], 0.5 * kf.log_det[k]
        W[:] = kf.R[k] + kf.floor
        _rotate(kf.Z[k], W, R)
        if kf.open[k] > 0.0:
            for i in range(6):
                W[i, i] += outliers[1 + i]
            _rotate(kf.Z[k], W, R_out)
        for way in range(ways):
            n = 12 if motion.has_velocity[way] > 0.0 else 6
            _predict(n, X[way], v[way], P[way], motion.noise[way], dt)
            _difference(X[way], kf.Z[k], e)
            if kf.open[k] > 0.0:
                outlier = half + _whiten(e, P[way], R_out, L, x)
                density = half + _whiten(e, P[way], R, L, x)
                inlier[way, k], density = inlier_share(density, outlier, outliers[0])
                if inlier[way, k] < 1.0 - 1e-9:
                    blend(kf, k, inlier[way, k], W)
                    cholesky.factor(W, six)
                    cholesky.inverse(W, L, six)
                    _rotate(kf.Z[k], L, W)
                    _whiten(e, P[way], W, L, x)
            else:
                density = half + _whiten(e, P[way], R, L, x)
            values[0, way] = values[1, way]
            values[1, way] += density
            _correct(n, X[way], v[way], P[way], L, x, K, step)
    return values


@hot
def explain(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> Array:
    """Completes `kf.explained`; returns what each way (M,) explains without the newest keyframe.

    Args:
        kf: Keyframes.
        motion: See `FreeMotion`.
        outliers: See `Priors`.
        inlier: (K,) see `log_evidences`, of the likeliest way; a result.
    """
    each = np.ones((kf.free.size, inlier.size))
    values = log_evidences(kf, motion, outliers, each)
    kf.explained[:] = values[1] + kf.free
    inlier[:] = each[np.argmax(kf.explained)]
    return values[0] + kf.free


@hot
def free_evidence(kf: Keyframes, motion: FreeMotion, outliers: Array, inlier: Array) -> float:
    """The log evidence of a body that no joint holds; see `explain`."""
    if np.isnan(kf.explained[0]):
        explain(kf, motion, outliers, inlier)
    top = kf.explained.max()
    return top + np.log(np.exp(kf.explained - top).mean())
