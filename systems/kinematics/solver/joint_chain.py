"""The chain of all configurations of a joint, filtered with its parameters unknown, compiled.

The configuration follows the white-acceleration process dq = v dt, dv = sqrt(S) dw from q = 0 at
the reference, v there from N(0, sigma_v^2). Given theta, each keyframe measures q with a variance
of 1/alpha, so that the chain is a two-state Kalman filter whose mean is m + M dtheta (the two-stage
filter of B. Friedland, "Treatment of bias in recursive filtering", 1969); its innovations are the
keyframes' information about theta. One pass gives the normal equations of theta with every q
marginalised, and the evidence of S by Laplace's approximation.

Motions begin and end at once, too. Where a keyframe is far from where it was expected, the rate may
have jumped since the one before with a far larger density J. Between both the expected logarithm of
the density counts for the step: an expected density would be a jump's already where one is most
unlikely.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.keyframes.outliers import inlier_share
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import PARAMETERS
from crossmodal.systems.kinematics.solver.joint_linearisation import Linear

_SURPRISE = 3.0  # Standard deviations off the expected from which a jump is considered.


class Chain(NamedTuple):
    """The filtered configuration: mean m + M dtheta and covariance P, at the newest keyframe.

    N are the parameters of the largest model.

    Attributes:
        m: (2,) q and its rate.
        M: (2, N) sensitivity to theta.
        P: (3,) variance of q, covariance, variance of its rate, given theta.
        S: (K,) density of the acceleration before each keyframe.
        H: (N, N) information about theta, all q marginalised; its factor after `solve`.
        h: (N,) information vector.
        step: (N,) dtheta.
    """

    m: Array
    M: Array
    P: Array
    S: Array
    H: Array
    h: Array
    step: Array


@hot
def new_chain(capacity: int, more: int = 0) -> Chain:
    """Room for `capacity` keyframes and some more parameters, zero."""
    n = PARAMETERS + more
    return Chain(
        np.zeros(2),
        np.zeros((2, n)),
        np.zeros(3),
        np.zeros(capacity),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(n),
    )


@hot
def take_information(n: int, lin: Linear, chain: Chain) -> None:
    """Begins with the information about theta that does not depend on the q of any keyframe."""
    for i in range(n):
        chain.h[i] = lin.vector[i]
        for j in range(i + 1):
            chain.H[i, j] = lin.information[i, j]


@hot
def run_chain(
    n: int,
    S: float,
    J: float,
    jumps: float,
    sigma_v: float,
    noise: float,
    q: Array,
    kf: Keyframes,
    lin: Linear,
    step: Array,
    since: int,
    chain: Chain,
) -> float:
    """Filters all q; returns the log likelihood of the keyframes from `since` on at dtheta = step.

    What does not depend on S is left out of it, unless all keyframes count and the step is zero.

    Args:
        n: Dimension of theta.
        S: Process noise, the density of the acceleration.
        J: The same of a jump.
        jumps: Probability of one between two keyframes.
        sigma_v: Standard deviation of the rate at the reference.
        noise: Factor on the variance 1 / alpha of each keyframe's q.
        q: Where each keyframe was linearised (K,).
        lin: They, linearised.
        step: (N,) see above.
        since: See above; negative if `chain.S` already has the density before each keyframe, so
            that no jumps are looked for. All keyframes count then.
    """
    m, M, H, h = chain.m, chain.M, chain.H, chain.h
    m[:] = 0.0
    M[:] = 0.0
    e_theta = np.empty(n)
    take_information(n, lin, chain)
    p00, p01, p11 = 0.0, 0.0, sigma_v * sigma_v
    value = lin.value[0]
    for k in range(1, kf.size[0]):
        dt = kf.time[k] - kf.time[k - 1]
        m[0] += dt * m[1]
        p00 += dt * (2.0 * p01 + dt * p11)
        p01 += dt * p11
        alpha = lin.alpha[k]
        e = q[k] + lin.g[k] / alpha - m[0]
        moved = e
        for i in range(n):
            M[0, i] += dt * M[1, i]
            e_theta[i] = -lin.beta[k, i] / alpha - M[0, i]
            moved += e_theta[i] * step[i]
        cube = dt**3 / 3.0
        S_k = chain.S[k] if since < 0 else S
        C = p00 + S_k * cube + noise / alpha
        density = -0.5 * (np.log(alpha * C) + moved * moved / C)
        if since >= 0 and S < J and moved * moved > _SURPRISE**2 * C:
            C += (J - S) * cube
            jumped = -0.5 * (np.log(alpha * C) + moved * moved / C)
            smooth_share, density = inlier_share(density, jumped, jumps)
            S_k = J * (S / J) ** smooth_share
            C += (S_k - J) * cube
        if k >= since:
            value += density
        chain.S[k] = S_k
        p00 += S_k * cube
        p01 += S_k * dt * dt / 2.0
        p11 += S_k * dt
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
        share = noise / alpha / C
        p11 -= k1 * p01
        p01 *= share
        p00 *= share
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
    n: int, S: Array, sigma_v: float, q: Array, kf: Keyframes, lin: Linear, step: Array, out: Array
) -> None:
    """Writes q of every keyframe given all keyframes and theta moved by `step` into `out`.

    S is `Chain.S`.
    """
    size = kf.size[0]
    f = np.zeros((size, 5))
    f[0, 4] = sigma_v * sigma_v
    for k in range(1, size):
        dt = kf.time[k] - kf.time[k - 1]
        q0, q1 = f[k - 1, 0] + dt * f[k - 1, 1], f[k - 1, 1]
        p00 = f[k - 1, 2] + dt * (2.0 * f[k - 1, 3] + dt * f[k - 1, 4]) + S[k] * dt**3 / 3.0
        p01 = f[k - 1, 3] + dt * f[k - 1, 4] + S[k] * dt * dt / 2.0
        p11 = f[k - 1, 4] + S[k] * dt
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
        dt = kf.time[k + 1] - kf.time[k]
        a, b, c = f[k, 2], f[k, 3], f[k, 4]
        p00 = a + dt * (2.0 * b + dt * c) + S[k + 1] * dt**3 / 3.0
        p01 = b + dt * c + S[k + 1] * dt * dt / 2.0
        p11 = c + S[k + 1] * dt
        det = p00 * p11 - p01 * p01
        d0, d1 = s0 - f[k, 0] - dt * f[k, 1], s1 - f[k, 1]
        if det <= 1e-14 * p00 * p11:  # Both keyframes are of one instant.
            out[k] = s0
            continue
        u0, u1 = (p11 * d0 - p01 * d1) / det, (p00 * d1 - p01 * d0) / det
        s0 = f[k, 0] + (a + b * dt) * u0 + b * u1
        s1 = f[k, 1] + (b + c * dt) * u0 + c * u1
        out[k] = s0
    out[0] = 0.0
