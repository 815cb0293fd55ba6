"""One update of the joint models with one relative pose, compiled.

Each update appends the pose to the packets, solves the prismatic, revolute and rigid models by
Gauss-Newton steps from the last solution (and from a fresh start while little has moved, because
the first solution can sit in a wrong minimum), and compares their evidence with the free walk's.
"""

import numba
import numpy as np
import numpy.typing as npt

from maths import cholesky
from systems.kinematics import pose_packets
from systems.kinematics.joint_geometry import (
    PRISMATIC,
    REVOLUTE,
    RIGID,
    dimension,
    retract,
    tangent_basis,
)
from systems.kinematics.joint_likelihood import (
    Chain,
    Linear,
    Models,
    add_packet,
    begin_linear,
    embedding,
    linearise,
    new_chain,
    new_linear,
    prior_offset,
    run_chain,
    smooth,
    solve,
)
from systems.kinematics.pose_packets import Packets, relative_log

Array = npt.NDArray[np.float64]

_STEPS = 3  # Gauss-Newton steps per update at most.
_STILL = 0.1  # Gain in log likelihood below which another step is not worth it.
_SIGNIFICANT = 4.0  # Standard deviations of q that decide its sign,
_MOVED = 10.0  # where the evidence is this many nats above the rigid model's.
_MEMORY = 40.0  # Nats by which dropped packets can speak against a model.


@numba.njit(cache=True)
def _solve_densities(
    kind: int, S: Array, sigma_v: float, m: Models, p: Packets, lin: Linear, a: Chain, b: Chain
) -> tuple[float, float, float, float]:
    """Solves for every S into `a` (the best stays there).

    Returns:
        Log evidence with S marginalised, the best S, its log likelihood and its gain.
    """
    n = dimension(kind)
    total, best, best_S, best_value, best_gain = 0.0, -np.inf, S[0], 0.0, 0.0
    for i in range(S.size):
        value = run_chain(n, S[i], sigma_v, m.q[kind], p, lin, b)
        evidence, gain = solve(n, value, b)
        if evidence > best:
            total = total * np.exp(best - evidence) + 1.0
            best, best_S, best_value, best_gain = evidence, S[i], value, gain
            a.m[:], a.M[:], a.P[:], a.H[:], a.step[:] = b.m, b.M, b.P, b.H, b.step
        else:
            total += np.exp(evidence - best)
    return best + np.log(total / S.size), best_S, best_value, best_gain


@numba.njit(cache=True)
def _store(kind: int, m: Models, chain: Chain) -> None:
    """Keeps the posterior of the newest packet."""
    n = dimension(kind)
    cholesky.inverse(chain.H, m.covariance[kind], n)
    for i in range(2):
        m.state[kind, i] = chain.m[i]
        for j in range(n):
            m.gain[kind, i, j] = chain.M[i, j]
            m.state[kind, i] += chain.M[i, j] * chain.step[j]
    m.P[kind, 0, 0], m.P[kind, 1, 1] = chain.P[0], chain.P[2]
    m.P[kind, 0, 1] = m.P[kind, 1, 0] = chain.P[1]


@numba.njit(cache=True)
def solve_moving(
    kind: int, m: Models, p: Packets, S: Array, sigma_v: float, sigma_c: float, steps: int
) -> None:
    """Gauss-Newton with step halving on theta and all q; stores posterior and evidence."""
    lin = new_linear(p.time.size)
    best, trial = new_chain(), new_chain()
    previous, q_previous = -np.inf, m.q[kind].copy()
    Y, a, c = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy()
    step = np.zeros(10)
    for i in range(steps):
        linearise(kind, m, p, sigma_c, lin)
        evidence, density, value, gain = _solve_densities(kind, S, sigma_v, m, p, lin, best, trial)
        if i > 0 and i < steps - 1 and value < previous - 1.0:
            step *= 0.3
            m.Y[kind], m.a[kind], m.c[kind] = Y, a, c
            m.q[kind] = q_previous + 0.3 * (m.q[kind] - q_previous)
            retract(kind, m.Y[kind], m.a[kind], m.c[kind], step)
            continue
        previous = value
        Y[:], a[:], c[:], q_previous[:] = m.Y[kind], m.a[kind], m.c[kind], m.q[kind]
        step[:] = best.step
        smooth(dimension(kind), density, sigma_v, q_previous, p, lin, step, m.q[kind])
        retract(kind, m.Y[kind], m.a[kind], m.c[kind], step)
        m.log_evidence[kind], m.density[kind] = evidence + m.carried[kind], density
        _store(kind, m, best)
        if gain < _STILL:
            break


@numba.njit(cache=True)
def solve_rigid(m: Models, p: Packets, sigma_c: float) -> None:
    """Two Gauss-Newton steps on the constant pose; the model is all but linear."""
    lin, chain = new_linear(p.time.size), new_chain()
    for _ in range(2):
        linearise(RIGID, m, p, sigma_c, lin)
        chain.H[:], chain.h[:] = lin.information, lin.vector
        evidence, gain = solve(6, lin.value[0], chain)
        retract(RIGID, m.Y[RIGID], m.a[RIGID], m.c[RIGID], chain.step)
        m.log_evidence[RIGID] = evidence + m.carried[RIGID]
        cholesky.inverse(chain.H, m.covariance[RIGID], 6)
        if gain < _STILL:
            break


@numba.njit(cache=True)
def walk_evidence(m: Models, p: Packets) -> None:
    """Log evidence of a body that walks freely, six random walks."""
    total = 0.5 * p.log_det[0] + p.walk[0] + m.carried[3]
    for k in range(p.size[0] - 1):
        total += p.pair[k, 1]
    m.log_evidence[3] = total


@numba.njit(cache=True)
def fresh_start(m: Models, p: Packets, sigma_c: float) -> None:
    """Starts both moving models from the principal direction of all packets' twists."""
    n = p.size[0]
    R = p.R[n - 1]
    scale = np.empty(6)
    scale[:3] = np.sqrt((R[0, 0] + R[1, 1] + R[2, 2]) / 3.0)
    scale[3:] = np.sqrt((R[3, 3] + R[4, 4] + R[5, 5]) / 3.0)
    xi, weight, mean = np.empty((n, 6)), np.empty(n), np.zeros(6)
    for k in range(n):
        relative_log(p.Z[0], p.Z[k], xi[k])
        xi[k] /= scale
        weight[k] = R[3, 3] / p.R[k, 3, 3]
        mean += weight[k] * xi[k]
    mean /= np.sum(weight)
    scatter = np.zeros((6, 6))
    for k in range(n):
        d = xi[k] - mean
        for i in range(6):
            for j in range(6):
                scatter[i, j] += weight[k] * d[i] * d[j]
    V = np.linalg.eigh(scatter)[1][:, 5] * scale
    straight = np.zeros(6)
    straight[3:] = np.linalg.eigh(np.ascontiguousarray(scatter[3:, 3:]))[1][:, 2]
    _start_models(m, p, V, straight, sigma_c)
    for kind in range(2):
        for i in range(4):
            for j in range(4):
                m.Y[kind, i, j] = 1.0 if i == j else 0.0
        for k in range(n):
            d = xi[k] * scale
            m.q[kind, k] = 0.0
            if kind == PRISMATIC:
                for i in range(3):
                    m.q[kind, k] += m.a[kind, i] * d[3 + i]
            else:
                x = _unit_twist(m.a[kind], m.c[kind])
                m.q[kind, k] = np.sum(x * d / scale**2) / np.sum((x / scale) ** 2)
        m.q[kind] -= m.q[kind, 0]


@numba.njit(cache=True)
def _unit_twist(a: Array, c: Array) -> Array:
    """The twist (6,) at Fo of a rotation of 1 rad/s about the axis through c."""
    x = np.empty(6)
    x[:3] = a
    x[3] = c[1] * a[2] - c[2] * a[1]
    x[4] = c[2] * a[0] - c[0] * a[2]
    x[5] = c[0] * a[1] - c[1] * a[0]
    return x


@numba.njit(cache=True)
def _start_models(m: Models, p: Packets, V: Array, straight: Array, sigma_c: float) -> None:
    """Axes from the twist direction V (6,) and the translation direction in `straight` (6,)."""
    m.a[PRISMATIC] = straight[3:] / np.sqrt(np.sum(straight**2))
    m.c[PRISMATIC] = 0.0
    v, w = V[3:], V[:3].copy()
    speed, rate = np.sqrt(np.sum(v**2)), np.sqrt(np.sum(w**2))
    if speed > 0.3 * rate:  # Only what is normal to the path bends it.
        w -= v * np.sum(w * v) / speed**2
        rate = np.sqrt(np.sum(w**2))
    if rate < 1e-9:
        B = np.empty((2, 3))
        tangent_basis(v / speed, B)
        w = B[0] * speed / sigma_c
        rate = speed / sigma_c
    a = w / rate
    rate = max(rate, speed / (1.5 * sigma_c))
    m.a[REVOLUTE] = a
    m.c[REVOLUTE, 0] = (a[1] * v[2] - a[2] * v[1]) / rate
    m.c[REVOLUTE, 1] = (a[2] * v[0] - a[0] * v[2]) / rate
    m.c[REVOLUTE, 2] = (a[0] * v[1] - a[1] * v[0]) / rate


@numba.njit(cache=True)
def _copy_model(kind: int, source: Models, target: Models) -> None:
    target.Y[kind], target.a[kind], target.c[kind] = source.Y[kind], source.a[kind], source.c[kind]
    target.q[kind], target.state[kind] = source.q[kind], source.state[kind]
    target.covariance[kind], target.gain[kind] = source.covariance[kind], source.gain[kind]
    target.P[kind], target.density[kind] = source.P[kind], source.density[kind]
    target.log_evidence[kind] = source.log_evidence[kind]


@numba.njit(cache=True)
def _turn(kind: int, m: Models) -> None:
    """Turns the axis, and with it the sign of q."""
    m.a[kind] *= -1.0
    m.q[kind] *= -1.0
    m.state[kind] *= -1.0
    m.gain[kind] *= -1.0
    for i in (6, 9):  # The basis normal to -a: the first vector stays, the second turns.
        m.gain[kind, :, i] *= -1.0
        m.covariance[kind, i, :] *= -1.0
        m.covariance[kind, :, i] *= -1.0


@numba.njit(cache=True)
def _decide_sign(kind: int, m: Models) -> None:
    """Turns the axis so that q grows positive in the direction first moved."""
    if m.signed[kind] > 0.0:
        return
    n = dimension(kind)
    gain = np.ascontiguousarray(m.gain[kind, 0, :n])
    variance = m.P[kind, 0, 0] + gain @ (np.ascontiguousarray(m.covariance[kind, :n, :n]) @ gain)
    moved = m.log_evidence[kind] > m.log_evidence[RIGID] + _MOVED
    if moved and m.state[kind, 0] ** 2 > _SIGNIFICANT**2 * variance:
        m.signed[kind] = 1.0
    if m.state[kind, 0] < 0.0:
        _turn(kind, m)


@numba.njit(cache=True)
def _drop(m: Models, p: Packets, k: int) -> None:
    """Keeps what packet k says about theta, its q left free, in the priors."""
    d, T = np.empty(12), np.empty((10, 12))
    lin = new_linear(p.time.size)
    for kind in range(3):
        m.signed[kind] = 1.0
        prior_offset(kind, m, d)
        gradient = m.prior_vector[kind] - m.prior_information[kind] @ d
        m.prior_value[kind] += 0.5 * np.sum(d * (m.prior_vector[kind] + gradient))
        m.prior_Y[kind], m.prior_a[kind], m.prior_c[kind] = m.Y[kind], m.a[kind], m.c[kind]
        begin_linear(kind, m, lin)
        add_packet(kind, m, p, k, lin)
        for i in range(10):
            for j in range(i):
                lin.information[j, i] = lin.information[i, j]
        embedding(m.a[kind], T)
        m.prior_information[kind] += T.T @ lin.information @ T
        m.prior_vector[kind] = gradient + T.T @ lin.vector
        m.prior_value[kind] += lin.value[0]


@numba.njit(cache=True)
def _solve_all(m: Models, p: Packets, S: Array, sigma_v: Array, sigma_c: float, steps: int) -> None:
    for kind in range(2):
        solve_moving(kind, m, p, S[kind], sigma_v[kind], sigma_c, steps)
    solve_rigid(m, p, sigma_c)
    walk_evidence(m, p)


@numba.njit(cache=True)
def make_room(
    m: Models,
    p: Packets,
    walk_rate: Array,
    S: Array,
    sigma_v: Array,
    sigma_c: float,
    coarseness: float,
) -> None:
    """Averages two packets, or drops one and keeps what it said, evidence included."""
    k, average = pose_packets.choose(p, coarseness)
    if average:
        pose_packets.merge(p, k, walk_rate)
    else:
        before = m.log_evidence.copy()
        _drop(m, p, k)
        pose_packets.drop(p, k, walk_rate)
    for kind in range(2):
        for i in range(k + 1 if average else k, p.size[0]):
            m.q[kind, i] = m.q[kind, i + 1]
    if not average:
        _solve_all(m, p, S, sigma_v, sigma_c, 1)
        m.carried[:] += before - m.log_evidence
        m.carried[:] -= np.max(m.carried)
        m.carried[:] = np.maximum(m.carried, -_MEMORY)


@numba.njit(cache=True)
def update(
    m: Models,
    p: Packets,
    X_FB: Array,
    R: Array,
    time: float,
    walk_rate: Array,
    S: Array,
    sigma_v: Array,
    sigma_c: float,
    coarseness: float,
    restart: bool,
) -> None:
    """Corrects all models with one relative pose, in place.

    Args:
        m: Models.
        p: Packets, the reference at least.
        X_FB: Pose (4, 4) relative to the measured reference.
        R: Its covariance (6, 6), in B.
        time: [s].
        walk_rate: Of the free walk (6,) [rad^2/s, m^2/s].
        S: Acceleration densities (2, n) to choose from [m^2/s^3] and [rad^2/s^3].
        sigma_v: Standard deviation (2,) of the first velocity [m/s] and [rad/s].
        sigma_c: Standard deviation of the distance from body to axis, per direction, [m].
        coarseness: See `pose_packets.choose`.
        restart: Whether to try a fresh start beside the last solution.
    """
    if p.size[0] == p.time.size:
        make_room(m, p, walk_rate, S, sigma_v, sigma_c, coarseness)
    pose_packets.append(p, X_FB, R, time, walk_rate)
    p.walk[0] = min(max(p.walk[0], -_MEMORY), _MEMORY)
    last, dt = p.size[0] - 1, time - p.time[p.size[0] - 2]
    for kind in range(2):
        m.q[kind, last] = m.state[kind, 0] + dt * m.state[kind, 1]
    _solve_all(m, p, S, sigma_v, sigma_c, _STEPS)
    if restart:
        other = Models(
            m.Y.copy(),
            m.a.copy(),
            m.c.copy(),
            m.q.copy(),
            m.signed.copy(),
            m.prior_information.copy(),
            m.prior_vector.copy(),
            m.prior_value.copy(),
            m.prior_Y.copy(),
            m.prior_a.copy(),
            m.prior_c.copy(),
            m.covariance.copy(),
            m.state.copy(),
            m.gain.copy(),
            m.P.copy(),
            m.density.copy(),
            m.log_evidence.copy(),
            m.carried.copy(),
        )
        fresh_start(other, p, sigma_c)
        for kind in range(2):
            solve_moving(kind, other, p, S[kind], sigma_v[kind], sigma_c, _STEPS + 2)
            if other.log_evidence[kind] > m.log_evidence[kind] + 0.1:
                if other.state[kind, 0] * m.state[kind, 0] < 0.0:
                    _turn(kind, other)
                _copy_model(kind, other, m)
    for kind in range(2):
        _decide_sign(kind, m)
