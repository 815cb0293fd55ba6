"""The likelihood of packets of relative poses under a joint, linearised and solved, compiled.

The parameters theta = (Y, a, c) and their tangent space are those of `joint_geometry`. The
configuration follows the white-acceleration process dq = v dt, dv = sqrt(S) dw from q = 0 at the
reference, v there from N(0, sigma_v^2).

Given theta, each packet says q to within 1/alpha, so that the chain of all q is a two-state Kalman
filter whose mean is m + M dtheta (the two-stage filter of B. Friedland, "Treatment of bias in
recursive filtering", 1969); its innovations are what the packets say about theta. One pass gives
the normal equations of theta with every q marginalised, and the evidence of S by Laplace's
approximation. Everything is linearised anew at each call, so no early linearisation stays.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maths import cholesky
from maths.compiled import hot
from systems.kinematics.joint_geometry import (
    REVOLUTE,
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
    tangent_basis,
)
from systems.kinematics.pose_packets import Packets, relative_log

Array = npt.NDArray[np.float64]

AXIS_SPREAD = 1.2  # [rad] per direction, of an axis spread evenly over the sphere.


class Models(NamedTuple):
    """Beliefs of the moving and rigid models; the first index is the model.

    Attributes:
        Y: (3, 4, 4) X_FB at the reference.
        a: (3, 3) axis in F.
        c: (3, 3) axis point in F, [m].
        q: (3, K) configuration at each packet.
        signed: (3,) one where the sign of q is decided.
        prior_information: (3, 12, 12) of dropped packets about (Y, a, c), a and c in three
            dimensions each, relative to where it was linearised.
        prior_vector: (3, 12) its information vector.
        prior_value: (3,) its log likelihood there.
        prior_Y: (3, 4, 4), prior_a: (3, 3), prior_c: (3, 3) where it was linearised.
        covariance: (3, 10, 10) of theta, after all packets.
        state: (3, 2) q and its rate at the newest packet.
        gain: (3, 2, 10) their sensitivity to theta.
        P: (3, 2, 2) their covariance given theta.
        density: (3,) the acceleration density S that explains the motion best.
        log_evidence: (4,) of each model, the free walk last.
        carried: (4,) from dropped packets.
    """

    Y: Array
    a: Array
    c: Array
    q: Array
    signed: Array
    prior_information: Array
    prior_vector: Array
    prior_value: Array
    prior_Y: Array
    prior_a: Array
    prior_c: Array
    covariance: Array
    state: Array
    gain: Array
    P: Array
    density: Array
    log_evidence: Array
    carried: Array


def initial_models(capacity: int) -> Models:
    """Models before any measurement, for `capacity` packets."""
    pose = np.tile(np.eye(4), (3, 1, 1))
    axis = np.tile(np.array([0.0, 0.0, 1.0]), (3, 1))
    point = np.zeros((3, 3))
    return Models(
        Y=pose,
        a=axis,
        c=point,
        q=np.zeros((3, capacity)),
        signed=np.zeros(3),
        prior_information=np.zeros((3, 12, 12)),
        prior_vector=np.zeros((3, 12)),
        prior_value=np.zeros(3),
        prior_Y=pose.copy(),
        prior_a=axis.copy(),
        prior_c=point.copy(),
        covariance=np.zeros((3, 10, 10)),
        state=np.zeros((3, 2)),
        gain=np.zeros((3, 2, 10)),
        P=np.zeros((3, 2, 2)),
        density=np.zeros(3),
        log_evidence=np.zeros(4),
        carried=np.zeros(4),
    )


class Linear(NamedTuple):
    """The packets linearised at one theta and q.

    Attributes:
        alpha: (K,) information about q in each packet.
        g: (K,) its information vector, relative to the q of linearisation.
        beta: (K, 10) its coupling with theta.
        information: (10, 10) about theta, lower triangle.
        vector: (10,) its information vector.
        value: (1,) log likelihood at the linearisation, each packet's own normaliser left out.
    """

    alpha: Array
    g: Array
    beta: Array
    information: Array
    vector: Array
    value: Array


@hot
def new_linear(capacity: int) -> Linear:
    """Room for `capacity` packets, zero."""
    return Linear(
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros((capacity, 10)),
        np.zeros((10, 10)),
        np.zeros(10),
        np.zeros(1),
    )


@hot
def _weigh(W: Array, k: int, rows: int, J: Array, WJ: Array) -> None:
    """Writes J W_k into `WJ`, both with `rows` rows of six."""
    for i in range(rows):
        for j in range(6):
            s = 0.0
            for n in range(6):
                s += J[i, n] * W[k, n, j]
            WJ[i, j] = s


@hot
def _add_normal_equations(
    W: Array, k: int, extra: int, J: Array, WJ: Array, H: Array, h: Array
) -> float:
    """Adds packet k's to H (10, 10), lower triangle, and h (10,); returns r^T W r.

    J holds the twist per unit of q, those per parameter of axis and point, and the residual r.
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
def _free_configuration(
    k: int, extra: int, J: Array, WJ: Array, lin_beta: Array, H: Array, h: Array
) -> tuple[float, float]:
    """Takes out of H and h what packet k's unknown q explains; returns its alpha and g."""
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
def _add_packets(
    kind: int,
    first: int,
    last: int,
    Y: Array,
    a: Array,
    c: Array,
    q: Array,
    Z: Array,
    W: Array,
    lin: Linear,
) -> None:
    """Adds packets `first` to `last` - 1; arrays are passed one by one for speed."""
    extra = dimension(kind) - 6
    rows = 2 + extra if kind != RIGID else 1
    J, WJ, G, X, B = (
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty((5, 6)),
        np.empty((4, 4)),
        np.empty((2, 3)),
    )
    H, h, beta, alphas, gs = lin.information, lin.vector, lin.beta, lin.alpha, lin.g
    r = J[rows - 1]
    tangent_basis(a, B)
    screw_twists(kind, Y, a, c, B, G)
    value = 0.0
    for k in range(first, last):
        child_pose(kind, Y, a, c, q[k], X)
        relative_log(X, Z[k], r)
        if kind != RIGID:
            jacobian(kind, G, q[k], J)
        _weigh(W, k, rows, J, WJ)
        value -= 0.5 * _add_normal_equations(W, k, rows - 2, J, WJ, H, h)
        if kind != RIGID and k > 0:
            alpha, g = _free_configuration(k, extra, J, WJ, beta, H, h)
            alphas[k], gs[k] = alpha, g
            value += 0.5 * g * g / alpha
    lin.value[0] += value


@hot
def add_packets(kind: int, m: Models, p: Packets, first: int, last: int, lin: Linear) -> None:
    """Linearises packets `first` to `last` - 1 and adds what they say about theta.

    Each packet's q is left free, except that of packet 0, where it is zero.
    """
    _add_packets(kind, first, last, m.Y[kind], m.a[kind], m.c[kind], m.q[kind], p.Z, p.W, lin)


@hot
def clear(lin: Linear) -> None:
    """Takes all packets out."""
    lin.information[:] = 0.0
    lin.vector[:] = 0.0
    lin.value[0] = 0.0


@hot
def prior_offset(kind: int, m: Models, d: Array) -> None:
    """Writes (Y, a, c) relative to where the prior was linearised into `d` (12,)."""
    relative_log(m.prior_Y[kind], m.Y[kind], d)
    for i in range(3):
        d[6 + i] = m.a[kind, i] - m.prior_a[kind, i]
        d[9 + i] = m.c[kind, i] - m.prior_c[kind, i]


@hot
def embedding(a: Array, T: Array) -> None:
    """Writes the tangent vectors of (Y, a, c) as rows of twelve components into `T` (10, 12)."""
    B = np.empty((2, 3))
    tangent_basis(a, B)
    T[:] = 0.0
    for i in range(6):
        T[i, i] = 1.0
    for i in range(2):
        for k in range(3):
            T[6 + i, 6 + k] = B[i, k]
            T[8 + i, 9 + k] = B[i, k]


@hot
def _add_prior(kind: int, m: Models, lin: Linear) -> None:
    """Adds what dropped packets said."""
    d, T = np.empty(12), np.empty((10, 12))
    prior_offset(kind, m, d)
    embedding(m.a[kind], T)
    n = dimension(kind)
    gradient, columns = np.empty(12), np.empty((10, 12))
    lin.value[0] += m.prior_value[kind]
    for i in range(12):
        gradient[i] = m.prior_vector[kind, i]
        for j in range(12):
            gradient[i] -= m.prior_information[kind, i, j] * d[j]
        lin.value[0] += 0.5 * d[i] * (m.prior_vector[kind, i] + gradient[i])
    for i in range(n):
        for j in range(12):
            lin.vector[i] += T[i, j] * gradient[j]
            columns[i, j] = 0.0
            for k in range(12):
                columns[i, j] += T[i, k] * m.prior_information[kind, k, j]
        for j in range(i + 1):
            for k in range(12):
                lin.information[i, j] += columns[i, k] * T[j, k]


@hot
def linearise(kind: int, m: Models, p: Packets, sigma_c: float, lin: Linear) -> None:
    """Fills `lin` with all packets and the priors of theta, at the model's theta and q."""
    clear(lin)
    add_packets(kind, m, p, 0, p.size[0], lin)
    if m.prior_information[kind, 0, 0] > 0.0:
        _add_prior(kind, m, lin)
    if kind == RIGID:
        return
    for i in range(2):
        lin.information[6 + i, 6 + i] += 1.0 / AXIS_SPREAD**2
    if kind == REVOLUTE:
        B, c = np.empty((2, 3)), m.c[kind]
        tangent_basis(m.a[kind], B)
        for i in range(2):
            along = c[0] * B[i, 0] + c[1] * B[i, 1] + c[2] * B[i, 2]
            lin.vector[8 + i] -= along / sigma_c**2
            lin.information[8 + i, 8 + i] += 1.0 / sigma_c**2
            lin.value[0] -= 0.5 * (along / sigma_c) ** 2
        lin.value[0] -= 2.0 * np.log(sigma_c)


class Chain(NamedTuple):
    """The filtered configuration: mean m + M dtheta and covariance P, at the newest packet.

    Attributes:
        m: (2,) q and its rate.
        M: (2, 10) sensitivity to theta.
        P: (3,) variance of q, covariance, variance of its rate, given theta.
        H: (10, 10) information about theta, all q marginalised; its factor after `solve`.
        h: (10,) information vector.
        step: (10,) dtheta.
    """

    m: Array
    M: Array
    P: Array
    H: Array
    h: Array
    step: Array


@hot
def new_chain() -> Chain:
    return Chain(
        np.zeros(2),
        np.zeros((2, 10)),
        np.zeros(3),
        np.zeros((10, 10)),
        np.zeros(10),
        np.zeros(10),
    )


@hot
def run_chain(
    n: int,
    S: float,
    sigma_v: float,
    noise: float,
    q: Array,
    p: Packets,
    lin: Linear,
    chain: Chain,
) -> float:
    """Filters all q; returns the log likelihood at dtheta = 0.

    Args:
        n: Dimension of theta.
        S: Acceleration density.
        sigma_v: Standard deviation of the rate at the reference.
        noise: Factor on the variance 1 / alpha of each packet's q.
        q: Where each packet was linearised (K,).
        p: Packets.
        lin: They, linearised.
        chain: Result.
    """
    m, M, H, h = chain.m, chain.M, chain.H, chain.h
    m[:] = 0.0
    M[:] = 0.0
    e_theta = np.empty(10)
    for i in range(n):
        h[i] = lin.vector[i]
        for j in range(i + 1):
            H[i, j] = lin.information[i, j]
    p00, p01, p11 = 0.0, 0.0, sigma_v * sigma_v
    value = lin.value[0]
    for k in range(1, p.size[0]):
        dt = p.time[k] - p.time[k - 1]
        m[0] += dt * m[1]
        p00 += dt * (2.0 * p01 + dt * p11) + S * dt**3 / 3.0
        p01 += dt * p11 + S * dt * dt / 2.0
        p11 += S * dt
        alpha = lin.alpha[k]
        C = p00 + noise / alpha
        e = q[k] + lin.g[k] / alpha - m[0]
        for i in range(n):
            M[0, i] += dt * M[1, i]
            e_theta[i] = -lin.beta[k, i] / alpha - M[0, i]
        value -= 0.5 * (np.log(alpha * C) + e * e / C)
        k0, k1 = p00 / C, p01 / C
        m[0] += k0 * e
        m[1] += k1 * e
        for i in range(n):
            M[0, i] += k0 * e_theta[i]
            M[1, i] += k1 * e_theta[i]
            h[i] -= e_theta[i] * e / C
            scaled = e_theta[i] / C
            for j in range(i + 1):
                H[i, j] += scaled * e_theta[j]
        p11 -= k1 * p01
        p01 -= k0 * p01
        p00 -= k0 * p00
    chain.P[0], chain.P[1], chain.P[2] = p00, p01, p11
    return value


@hot
def solve(n: int, value: float, chain: Chain) -> tuple[float, float]:
    """Solves for dtheta; returns the log evidence by Laplace and the gain in log likelihood."""
    log_det = cholesky.factor(chain.H, n)
    for i in range(n):
        chain.step[i] = chain.h[i]
    cholesky.forward(chain.H, chain.step, n)
    gain = 0.0
    for i in range(n):
        gain += 0.5 * chain.step[i] ** 2
    cholesky.backward(chain.H, chain.step, n)
    return value + gain - 0.5 * log_det, gain


@hot
def smooth(
    n: int, S: float, sigma_v: float, q: Array, p: Packets, lin: Linear, step: Array, out: Array
) -> None:
    """Writes q of every packet given all packets and theta moved by `step` into `out`."""
    size = p.size[0]
    f = np.zeros((size, 5))
    f[0, 4] = sigma_v * sigma_v
    for k in range(1, size):
        dt = p.time[k] - p.time[k - 1]
        q0, q1 = f[k - 1, 0] + dt * f[k - 1, 1], f[k - 1, 1]
        p00 = f[k - 1, 2] + dt * (2.0 * f[k - 1, 3] + dt * f[k - 1, 4]) + S * dt**3 / 3.0
        p01 = f[k - 1, 3] + dt * f[k - 1, 4] + S * dt * dt / 2.0
        p11 = f[k - 1, 4] + S * dt
        z = q[k] + lin.g[k] / lin.alpha[k]
        for i in range(n):
            z -= lin.beta[k, i] * step[i] / lin.alpha[k]
        C = p00 + 1.0 / lin.alpha[k]
        k0, k1 = p00 / C, p01 / C
        f[k, 0], f[k, 1] = q0 + k0 * (z - q0), q1 + k1 * (z - q0)
        f[k, 2], f[k, 3], f[k, 4] = p00 - k0 * p00, p01 - k0 * p01, p11 - k1 * p01
    s0, s1 = f[size - 1, 0], f[size - 1, 1]
    out[size - 1] = s0
    for k in range(size - 2, -1, -1):
        dt = p.time[k + 1] - p.time[k]
        a, b, c = f[k, 2], f[k, 3], f[k, 4]
        p00 = a + dt * (2.0 * b + dt * c) + S * dt**3 / 3.0
        p01 = b + dt * c + S * dt * dt / 2.0
        p11 = c + S * dt
        det = p00 * p11 - p01 * p01
        d0, d1 = s0 - f[k, 0] - dt * f[k, 1], s1 - f[k, 1]
        if det <= 1e-14 * p00 * p11:  # No time in between, the same state.
            out[k] = s0
            continue
        u0, u1 = (p11 * d0 - p01 * d1) / det, (p00 * d1 - p01 * d0) / det
        s0 = f[k, 0] + (a + b * dt) * u0 + b * u1
        s1 = f[k, 1] + (b + c * dt) * u0 + c * u1
        out[k] = s0
    out[0] = 0.0
