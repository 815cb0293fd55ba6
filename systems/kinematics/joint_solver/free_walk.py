"""The evidence of a body that walks freely, compiled.

The child's pose is a random walk, a pose filter over the keyframes: at each the covariance grows by
the walk's noise times the time that has passed. It is the type that wins where no joint explains
the motion.
"""

import numpy as np

from maths import cholesky
from maths.arrays import Array
from maths.compiled import hot
from maths.se3_in_place import perturb, relative_log
from systems.kinematics.joint_solver.outliers import blend, inlier_share
from systems.kinematics.joint_solver.pose_keyframes import Keyframes

SCALES = (1.0, 0.1, 0.01)  # Of the walk's noise.


@hot
def _log_density(e: Array, P: Array, R: Array, log_det: float) -> float:
    """Of an innovation e ~ N(0, P + R), relative to the normaliser of R."""
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    L, x = P + R, e.copy()
    total = cholesky.factor(L, six) - log_det
    cholesky.forward(L, x, six)
    for i in range(6):
        total += x[i] * x[i]
    return -0.5 * total


@hot
def _correct(X: Array, P: Array, e: Array, R: Array) -> None:
    """Kalman update of the pose X and its covariance P, in place."""
    six = int(np.int64(6))
    L, columns, x = P + R, P.copy(), e.copy()
    cholesky.factor(L, six)
    cholesky.forward(L, x, six)
    for j in range(6):
        cholesky.forward(L, columns[j], six)  # Row j is L^-1 P e_j, since P is symmetric.
    step = columns @ x
    for i in range(6):
        for j in range(i + 1):
            s = P[i, j]
            for n in range(6):
                s -= columns[i, n] * columns[j, n]
            P[i, j] = s
            P[j, i] = s
    perturb(X, step, X)


@hot
def walk_at_scale(
    kf: Keyframes, walk_noise: Array, scale: float, outliers: Array, inlier: Array
) -> float:
    """`free_walk` with one scale of its noise."""
    six = int(np.int64(6))
    X, P, e = kf.Z[0].copy(), kf.R[0].copy(), np.empty(6)
    R, W = np.empty((6, 6)), np.empty((6, 6))
    value = 0.5 * kf.log_det[0]
    inlier[0] = 1.0
    for k in range(1, kf.size[0]):
        for i in range(6):
            P[i, i] += scale * walk_noise[i] * (kf.time[k] - kf.time[k - 1])
        relative_log(X, kf.Z[k], e)
        R[:] = kf.R[k] + kf.floor
        density = _log_density(e, P, R, kf.log_det[k])
        if kf.open[k] > 0.0:
            for i in range(6):
                R[i, i] += outliers[1 + i]
            outlier = _log_density(e, P, R, kf.log_det[k])
            inlier[k], density = inlier_share(density, outlier, outliers[0])
            for i in range(6):
                R[i, i] -= outliers[1 + i]
            if inlier[k] < 1.0 - 1e-9:
                blend(kf, k, inlier[k], W)
                cholesky.factor(W, six)
                cholesky.inverse(W, R, six)
        value += density
        _correct(X, P, e, R)
    return value


@hot
def free_walk(kf: Keyframes, walk_noise: Array, outliers: Array, inlier: Array) -> float:
    """The log evidence of the keyframes, each one's own normaliser left out.

    How fast the body walks is not known: the evidence is the mean over several scales.

    Args:
        kf: Keyframes.
        walk_noise: See `Priors`, of the fastest walk.
        outliers: See `Priors`.
        inlier: (K,) probability that each open keyframe is none, given those before it; a result.
    """
    total, top = 0.0, -np.inf
    trial = np.ones(inlier.size)
    for scale in SCALES:
        value = walk_at_scale(kf, walk_noise, scale, outliers, trial)
        if value > top:
            total = total * np.exp(top - value) + 1.0
            top = value
            kf.walk[1] = scale
            inlier[:] = trial
        else:
            total += np.exp(value - top)
    return top + np.log(total / len(SCALES))
