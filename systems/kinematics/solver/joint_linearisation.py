"""Keyframes of relative poses linearised about one joint, compiled.

The parameters theta = (Y, a, c, h) and their tangent space are those of `joint_geometry`. A
keyframe's residual is the rotation vector and the translation of X_FB(q)^-1 Z, in B, so that a
rotation that was not measured does not affect the translation. Its q is left free: the remaining
information is about theta alone, and that about q is kept beside it for the chain of all q
(`joint_chain`).

Keyframes are linearised anew at each call; only those that were marginalised keep the point of
their linearisation.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.se3_in_place import pose_difference, relative_log
from crossmodal.maths.vectors import tangent_basis
from crossmodal.systems.kinematics.keyframes.outliers import blend, weigh_residual
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import (
    PARAMETERS,
    RIGID,
    SCREW,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_models import AXIS_SPREAD, Models, has_prior
from crossmodal.systems.kinematics.solver.parameter_priors import WIDEST, axis_prior


class Linear(NamedTuple):
    """The keyframes linearised at one theta and q.

    N are the parameters of the largest model.

    Attributes:
        alpha: (K,) information about q in each keyframe.
        g: (K,) its information vector, relative to the q of linearisation.
        beta: (K, N) its coupling with theta.
        information: (N, N) about theta, lower triangle.
        vector: (N,) its information vector.
        value: (1,) log likelihood at the linearisation, each keyframe's own normaliser left out.
    """

    alpha: Array
    g: Array
    beta: Array
    information: Array
    vector: Array
    value: Array


@hot
def new_linear(capacity: int, more: int = 0) -> Linear:
    """Room for `capacity` keyframes and some more parameters, zero."""
    n = PARAMETERS + more
    return Linear(
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros((capacity, n)),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(1),
    )


@hot
def weigh(W: Array, k: int, rows: int, J: Array, WJ: Array) -> None:
    """Writes J W_k into `WJ`, both with `rows` rows of six."""
    for i in range(rows):
        for j in range(6):
            WJ[i, j] = 0.0
        for n in range(6):
            for j in range(6):
                WJ[i, j] += J[i, n] * W[k, n, j]


@hot
def add_normal_equations(
    W: Array, k: int, extra: int, J: Array, WJ: Array, H: Array, h: Array
) -> float:
    """Adds keyframe k's to H, lower triangle, and h; returns r^T W r.

    J holds the twist per unit of q, those per parameter of the screw, and the residual r.
    """
    r = 1 + extra
    for i in range(6):
        h[i] += WJ[r, i]
        for j in range(i + 1):
            H[i, j] += W[k, i, j]
    for i in range(extra):
        for j in range(6):
            h[6 + i] += J[1 + i, j] * WJ[r, j]
            H[6 + i, j] += WJ[1 + i, j]
        for j in range(i + 1):
            for n in range(6):
                H[6 + i, 6 + j] += J[1 + i, n] * WJ[1 + j, n]
    square = 0.0
    for j in range(6):
        square += J[r, j] * WJ[r, j]
    return square


@hot
def free_configuration(
    k: int, extra: int, J: Array, WJ: Array, lin_beta: Array, H: Array, h: Array
) -> tuple[float, float]:
    """Takes out of H and h what keyframe k's unknown q explains; returns its alpha and g."""
    alpha, g = 0.0, 0.0
    for j in range(6):
        alpha += J[0, j] * WJ[0, j]
        g += J[1 + extra, j] * WJ[0, j]
        lin_beta[k, j] = WJ[0, j]
    for i in range(extra):
        s = 0.0
        for j in range(6):
            s += J[1 + i, j] * WJ[0, j]
        lin_beta[k, 6 + i] = s
    for i in range(6 + extra):
        scaled = lin_beta[k, i] / alpha
        h[i] -= scaled * g
        for j in range(i + 1):
            H[i, j] -= scaled * lin_beta[k, j]
    return alpha, g


@hot
def add_keyframe(
    k: int, extra: int, q_is_free: bool, W: Array, row: int, J: Array, WJ: Array, lin: Linear
) -> tuple[float, float]:
    """Adds keyframe k, linearised in J and weighted by W[row], and leaves its q free or at zero.

    Writes the weighted rows into `WJ`; returns r^T W r, and half of what q explains of it.
    """
    weigh(W, row, extra + 2, J, WJ)
    square = add_normal_equations(W, row, extra, J, WJ, lin.information, lin.vector)
    if not q_is_free:
        return square, 0.0
    alpha, g = free_configuration(k, extra, J, WJ, lin.beta, lin.information, lin.vector)
    lin.alpha[k], lin.g[k] = alpha, g
    return square, 0.5 * g * g / alpha


@hot
def add_keyframes(
    kind: int,
    m: Models,
    kf: Keyframes,
    first: int,
    last: int,
    share: float,
    temper: float,
    lin: Linear,
) -> None:
    """Linearises keyframes `first` to `last` - 1 and adds their information about theta.

    Each keyframe's q is left free, except that of keyframe 0, where it is zero.
    """
    Y, a, c, pitch = m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind]
    q, inlier = m.q[kind], m.inlier[kind]
    extra = dimension(kind) - 6
    rows = 2 + extra if kind != RIGID else 1
    J, WJ, G, X = np.empty((7, 6)), np.empty((7, 6)), np.empty((6, 6)), np.empty((4, 4))
    W_in, W_out, log_out, r = kf.W, kf.W_out, kf.log_out, J[rows - 1]
    screw_twists(kind, Y, a, c, pitch, G)
    value, spared, blended = 0.0, np.zeros(6), np.empty((1, 6, 6))
    for k in range(first, last):
        child_pose(kind, Y, a, c, pitch, q[k], X)
        pose_difference(X, kf.Z[k], r)
        if kind != RIGID:
            jacobian(kind, G, pitch, q[k], J)
        # No later measurement confirms where along the path the newest keyframe is.
        is_spared = kind != RIGID and k > 0 and k == kf.size[0] - 1 and kf.undecided[k] > 0.0
        W, row = W_in, k
        if kf.undecided[k] > 0.0:
            for i in range(6):
                spared[i] = J[0, i] if is_spared else 0.0
            inlier[k], density = weigh_residual(W_in, W_out, log_out, k, r, spared, share, temper)
            blend(W_in, W_out, k, inlier[k], blended[0])
            W, row = blended, 0
            value += density
        square, gain = add_keyframe(k, rows - 2, kind != RIGID and k > 0, W, row, J, WJ, lin)
        value -= 0.0 if kf.undecided[k] > 0.0 else 0.5 * square
        value += 0.0 if is_spared else gain
    lin.value[0] += value


@hot
def clear(lin: Linear) -> None:
    """Takes all keyframes out."""
    lin.information[:] = 0.0
    lin.vector[:] = 0.0
    lin.value[0] = 0.0


@hot
def prior_offset(kind: int, m: Models, d: Array) -> None:
    """Writes (Y, a, c, pitch) relative to where the prior was linearised into `d` (N + 2,)."""
    relative_log(m.prior_Y[kind], m.Y[kind], d)
    for i in range(3):
        d[6 + i] = m.a[kind, i] - m.prior_a[kind, i]
        d[9 + i] = m.c[kind, i] - m.prior_c[kind, i]
    d[12] = m.pitch[kind] - m.prior_pitch[kind]


@hot
def embedding(a: Array, T: Array) -> None:
    """Writes the tangent vectors of (Y, a, c, pitch) as rows into `T` (N, N + 2)."""
    B = np.empty((2, 3))
    tangent_basis(a, B)
    T[:] = 0.0
    for i in range(6):
        T[i, i] = 1.0
    for i in range(2):
        for k in range(3):
            T[6 + i, 6 + k] = B[i, k]
            T[8 + i, 9 + k] = B[i, k]
    T[10, 12] = 1.0


@hot
def add_prior(kind: int, m: Models, lin: Linear) -> None:
    """Adds the prior that marginalised keyframes have left."""
    size = PARAMETERS + 2
    d, T = np.empty(size), np.empty((PARAMETERS, size))
    prior_offset(kind, m, d)
    embedding(m.a[kind], T)
    n = dimension(kind)
    gradient, columns = np.empty(size), np.empty((PARAMETERS, size))
    lin.value[0] += m.prior_value[kind]
    for i in range(size):
        gradient[i] = m.prior_vector[kind, i]
        for j in range(size):
            gradient[i] -= m.prior_information[kind, i, j] * d[j]
        lin.value[0] += 0.5 * d[i] * (m.prior_vector[kind, i] + gradient[i])
    for i in range(n):
        for j in range(size):
            lin.vector[i] += T[i, j] * gradient[j]
            columns[i, j] = 0.0
            for k in range(size):
                columns[i, j] += T[i, k] * m.prior_information[kind, k, j]
        for j in range(i + 1):
            for k in range(size):
                lin.information[i, j] += columns[i, k] * T[j, k]


@hot
def add_priors(kind: int, m: Models, sigma_c: float, far: bool, lin: Linear) -> None:
    """Adds what is known of theta without the keyframes; see `axis_prior` for the arguments."""
    if has_prior(kind, m):
        add_prior(kind, m, lin)
    if kind == RIGID:
        return
    for i in range(2):
        lin.information[6 + i, 6 + i] += 1.0 / AXIS_SPREAD**2
    if turns(kind):
        B, c = np.empty((2, 3)), m.c[kind]
        tangent_basis(m.a[kind], B)
        square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        value, information = axis_prior(square, sigma_c, far)
        for i in range(2):
            along = c[0] * B[i, 0] + c[1] * B[i, 1] + c[2] * B[i, 2]
            lin.vector[8 + i] -= along * information
            lin.information[8 + i, 8 + i] += information
        lin.value[0] += value
    if kind == SCREW:
        lin.vector[10] -= m.pitch[kind] / WIDEST**2
        lin.information[10, 10] += 1.0 / WIDEST**2
        lin.value[0] -= 0.5 * (m.pitch[kind] / WIDEST) ** 2 + np.log(WIDEST)


@hot
def linearise(
    kind: int,
    m: Models,
    kf: Keyframes,
    sigma_c: float,
    far: bool,
    share: float,
    temper: float,
    lin: Linear,
) -> None:
    """Fills `lin` with all keyframes and the priors of theta, at the model's theta and q."""
    clear(lin)
    add_keyframes(kind, m, kf, int(np.int64(0)), kf.size[0], share, temper, lin)
    add_priors(kind, m, sigma_c, far, lin)
