"""Keyframes linearised about a joint, with smooth errors beside the independent ones, compiled.

The errors are a sum of waves, functions of the keyframes in B, with unknown normal coefficients.
The coefficients are more parameters of the chain of all configurations, which are marginalised at
its end. A child's deviations from a path are a short cosine series over the configuration, and
there is none along the path; how a tracker's errors change in time is in `wander`.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes, floor_share
from crossmodal.systems.kinematics.solver.joint_chain import Chain
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
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

_WAVES = 4  # Of a path's deviations, in each of six directions.
PATH_WAVES = 6 * _WAVES


class Waves(NamedTuple):
    """C functions of the keyframes, each in one direction and with a normal coefficient.

    Attributes:
        value: (K, C) at each keyframe.
        direction: (C,) index of a perturbation, in B.
        variance: (C,) of its coefficient.
        along: (C,) one, or zero where there is none along the path.
    """

    value: Array
    direction: Ids
    variance: Array
    along: Array


@hot
def no_waves(capacity: int) -> Waves:
    """None, for `capacity` keyframes."""
    return Waves(np.zeros((capacity, 0)), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))


@hot
def with_path_waves(q: Array, size: int, deviations: Array, others: Waves) -> Waves:
    """Adds those of smooth deviations from a path to other waves.

    Args:
        q: (K,) configuration at each keyframe, of which `size` are in use.
        deviations: Covariance (6, 6) of the first wave.
    """
    low, high, first = q[:size].min(), q[:size].max(), others.variance.size
    count = first + PATH_WAVES
    value = np.zeros((others.value.shape[0], count))
    direction, variance, along = np.empty(count, dtype=np.int64), np.empty(count), np.zeros(count)
    for c in range(first):
        direction[c], variance[c] = others.direction[c], others.variance[c]
        along[c] = others.along[c]
        for k in range(size):
            value[k, c] = others.value[k, c]
    for i in range(_WAVES):
        for d in range(6):
            c = first + 6 * i + d
            direction[c], variance[c] = d, deviations[d, d] / (i + 1.0) ** 4
            for k in range(size):
                place = (q[k] - low) / (high - low) if high > low else 0.0
                value[k, c] = np.cos((i + 1) * np.pi * place)
    return Waves(value, direction, variance, along)


@hot
def _add_waves(
    n: int, residual: int, k: int, share: float, waves: Waves, W: Array, WJ: Array, lin: Linear
) -> None:
    """Adds what keyframe k says of the waves' coefficients, which follow the n parameters.

    Row `residual` of WJ is the residual, those between the first and it the derivatives by the
    parameters of the screw, all weighted by W (1, 6, 6), in which q is left free.
    """
    H, h = lin.information, lin.vector
    for i in range(waves.variance.size):
        a, d = share * waves.value[k, i], waves.direction[i]
        h[n + i] += a * WJ[residual, d]
        for p in range(6):
            H[n + i, p] += a * W[0, p, d]
        for p in range(1, residual):
            H[n + i, 5 + p] += a * WJ[p, d]
        for j in range(i + 1):
            b = share * waves.value[k, j]
            H[n + i, n + j] += a * b * W[0, d, waves.direction[j]]
        lin.beta[k, n + i] = a * waves.along[i] * lin.beta[k, d]


@hot
def add_keyframes(
    kind: int,
    m: Models,
    kf: Keyframes,
    rough: Array,
    waves: Waves,
    lin: Linear,
) -> None:
    """Adds all keyframes, each with an independent error of the covariance `rough` (6, 6) besides.

    The waves' coefficients follow the joint's parameters. `lin.value` has the normalisers.
    """
    six, first, extra, size = int(np.int64(6)), int(np.int64(0)), dimension(kind) - 6, kf.size[0]
    rows = 2 + extra if kind != RIGID else 1
    of = PRISMATIC if kind == BENT_SLIDE else kind
    Y, a, c, pitch, q = m.Y[of], m.a[of], m.c[of], m.pitch[of], m.q[of]
    X, G, A = np.empty((4, 4)), np.empty((6, 6)), np.empty((6, 6))
    J, WJ, W = np.empty((7, 6)), np.empty((7, 6)), np.empty((1, 6, 6))
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
        if waves.variance.size > 0 and kind != RIGID and k > 0:
            # Only what is not information about q is about a deviation.
            for i in range(6):
                for j in range(6):
                    W[0, i, j] -= WJ[0, i] * WJ[0, j] / lin.alpha[k]
            weigh(W, first, rows, J, WJ)
        _add_waves(6 + extra, rows - 1, k, share, waves, W, WJ, lin)


@hot
def marginalise(n: int, waves: Waves, chain: Chain) -> float:
    """Takes the coefficients out of the information about n parameters; returns their evidence.

    What `add_coefficients` needs stays in the coefficients' rows of `chain.H` and `chain.h`.
    """
    size, value = int(waves.variance.size), 0.0
    S, s, column = (
        chain.H[n : n + size, n : n + size].copy(),
        chain.h[n:].copy(),
        np.empty((n, size)),
    )
    for i in range(size):
        S[i, i] += 1.0 / waves.variance[i]
        value -= 0.5 * np.log(waves.variance[i])
    value -= 0.5 * cholesky.factor(S, size)
    cholesky.forward(S, s, size)
    for j in range(size):
        value += 0.5 * s[j] ** 2
        chain.h[n + j] = s[j]
        for k in range(size):
            chain.H[n + j, n + k] = S[j, k]
    for i in range(n):
        for j in range(size):
            column[i, j] = chain.H[n + j, i]
        cholesky.forward(S, column[i], size)
        for j in range(size):
            chain.h[i] -= column[i, j] * s[j]
            chain.H[n + j, i] = column[i, j]
        for p in range(i + 1):
            for j in range(size):
                chain.H[i, p] -= column[i, j] * column[p, j]
    return value


@hot
def add_coefficients(n: int, waves: Waves, chain: Chain) -> None:
    """Adds the coefficients to a step of n parameters, once `marginalise` has taken them out."""
    size = int(waves.variance.size)
    S, s = chain.H[n : n + size, n : n + size].copy(), chain.h[n:].copy()
    for j in range(size):
        for i in range(n):
            s[j] -= chain.H[n + j, i] * chain.step[i]
    cholesky.backward(S, s, size)
    for j in range(size):
        chain.step[n + j] = s[j]
