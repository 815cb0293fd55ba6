"""One update of the joint models with one relative pose, compiled.

Each update appends the pose to the packets, solves the prismatic, revolute and rigid models by
Gauss-Newton steps from the last solution (and from a fresh start while little has moved, because
the first solution can sit in a wrong minimum), and compares their evidence with the free walk's.
"""

from typing import NamedTuple

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


class Priors(NamedTuple):
    """What is known of joints before anything is measured, and of the measurements' errors.

    Attributes:
        densities: Acceleration densities (n,) of the child to choose from, [m^2/s^3].
        speed: Standard deviation of the child's first speed, [m/s].
        radius: Lever of a rotation about the child itself, [m].
        axis_distance: Standard deviation from child to axis, per direction, [m].
        walk_rate: Of the free walk (6,) [rad^2/s, m^2/s].
        coarseness: See `pose_packets.choose`.
        fast: Share of each measurement's variance that is new at each, one for white noise.
        slow: Share of it that stays for a while and cannot be told from motion.
    """

    densities: Array
    speed: float
    radius: float
    axis_distance: float
    walk_rate: Array
    coarseness: float
    fast: float
    slow: float


_STEPS = 3  # Gauss-Newton steps per update at most.
_STILL = 0.1  # Gain in log likelihood below which another step is not worth it.
_TILT = 0.7  # Most that one step may tilt an axis, [rad],
_SHIFT = 0.5  # or move it, as a share of its distance.
_PROMISED = 1.0  # Gain that a step not yet taken may count as evidence, [nat].
_SIGNIFICANT = 4.0  # Standard deviations of q that decide its sign,
_MOVED = 10.0  # where the evidence is this many nats above the rigid model's.
_MEMORY = 40.0  # Nats by which dropped packets can speak against a model.


@numba.njit(cache=True)
def _lever(kind: int, m: Models, priors: Priors) -> float:
    """How far the child moves per unit of q; one rule for joints of any radius, [m] per unit."""
    if kind == PRISMATIC:
        return 1.0
    c = m.c[kind]
    return np.sqrt(priors.radius**2 + c[0] ** 2 + c[1] ** 2 + c[2] ** 2)


@numba.njit(cache=True)
def _solve_densities(
    kind: int, m: Models, p: Packets, priors: Priors, lin: Linear, best: Chain, trial: Chain
) -> tuple[float, float, float, float]:
    """Solves for every acceleration density; the best solution stays in `best`.

    Returns:
        Log evidence with the density marginalised, the best density S, its log likelihood and gain.
    """
    n, lever = dimension(kind), _lever(kind, m, priors)
    total, top, best_S, best_value, best_gain = 0.0, -np.inf, 0.0, 0.0, 0.0
    for density in priors.densities:
        S = density / lever**2
        value = run_chain(n, S, priors.speed / lever, 1.0, m.q[kind], p, lin, trial)
        evidence, gain = solve(n, value, trial)
        if evidence > top:
            total = total * np.exp(top - evidence) + 1.0
            top, best_S, best_value, best_gain = evidence, S, value, gain
            best.m[:], best.M[:], best.P[:] = trial.m, trial.M, trial.P
            best.H[:], best.step[:] = trial.H, trial.step
        else:
            total += np.exp(evidence - top)
    return top + np.log(total / priors.densities.size), best_S, best_value, best_gain


@numba.njit(cache=True)
def _track(
    kind: int, m: Models, p: Packets, priors: Priors, lin: Linear, best: Chain, trial: Chain
) -> float:
    """Filters q anew with the errors' fast share only, into `best`; returns its density S.

    A slow error moves along with q: following the measurement is then better than smoothing it.
    What theta is worth stays as it is; the slow share comes on top of the variance of q.
    """
    n, lever, q = dimension(kind), _lever(kind, m, priors), m.q[kind].copy()
    top, best_S = -np.inf, 0.0
    for density in priors.densities:
        S = density / lever**2
        value = run_chain(n, S, priors.speed / lever, priors.fast, q, p, lin, trial)
        for i in range(n):
            value += trial.h[i] * best.step[i] - 0.5 * trial.H[i, i] * best.step[i] ** 2
            for j in range(i):
                value -= trial.H[i, j] * best.step[i] * best.step[j]
        if value > top:
            top, best_S = value, S
            best.m[:], best.M[:], best.P[:] = trial.m, trial.M, trial.P
    best.P[0] += priors.slow / lin.alpha[p.size[0] - 1]
    return best_S


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
def _trusted(kind: int, c: Array, step: Array) -> float:
    """The share of a step within which the linearisation can be trusted."""
    tilt = np.sqrt(step[6] ** 2 + step[7] ** 2)
    share = 1.0 if tilt < _TILT else _TILT / tilt
    if kind == REVOLUTE:
        shift = np.sqrt(step[8] ** 2 + step[9] ** 2)
        limit = _SHIFT * (0.3 + np.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2))
        share = min(share, 1.0 if shift < limit else limit / shift)
    return share


@numba.njit(cache=True)
def solve_moving(kind: int, m: Models, p: Packets, priors: Priors, steps: int) -> None:
    """Gauss-Newton with step halving on theta and all q; stores posterior and evidence."""
    lin = new_linear(p.time.size)
    best, trial = new_chain(), new_chain()
    previous, q_previous = -np.inf, m.q[kind].copy()
    Y, a, c = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy()
    step = np.zeros(10)
    for i in range(steps):
        linearise(kind, m, p, priors.axis_distance, lin)
        evidence, S, value, gain = _solve_densities(kind, m, p, priors, lin, best, trial)
        if i > 0 and i < steps - 1 and value < previous - 1.0:
            step *= 0.3
            m.Y[kind], m.a[kind], m.c[kind] = Y, a, c
            m.q[kind] = q_previous + 0.3 * (m.q[kind] - q_previous)
            retract(kind, m.Y[kind], m.a[kind], m.c[kind], step)
            continue
        previous = value
        Y[:], a[:], c[:], q_previous[:] = m.Y[kind], m.a[kind], m.c[kind], m.q[kind]
        best.step[:] *= _trusted(kind, m.c[kind], best.step)
        step[:] = best.step
        sigma_v = priors.speed / _lever(kind, m, priors)
        smooth(dimension(kind), S, sigma_v, q_previous, p, lin, step, m.q[kind])
        last = i == steps - 1 or gain < _STILL
        if last and priors.fast < 1.0:
            m.q[kind], q_smooth = q_previous, m.q[kind].copy()
            S = _track(kind, m, p, priors, lin, best, trial)
            m.q[kind] = q_smooth
        retract(kind, m.Y[kind], m.a[kind], m.c[kind], step)
        evidence -= max(gain - _PROMISED, 0.0)
        m.log_evidence[kind], m.density[kind] = evidence + m.carried[kind], S
        _store(kind, m, best)
        if last:
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
def fresh_start(m: Models, p: Packets, axis_distance: float) -> None:
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
    _start_models(m, V, straight, axis_distance)
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
def _start_models(m: Models, V: Array, straight: Array, axis_distance: float) -> None:
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
        w = B[0] * speed / axis_distance
        rate = speed / axis_distance
    a = w / rate
    rate = max(rate, speed / (1.5 * axis_distance))
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
def _solve_all(m: Models, p: Packets, priors: Priors, steps: int) -> None:
    for kind in range(2):
        solve_moving(kind, m, p, priors, steps)
    solve_rigid(m, p, priors.axis_distance)
    walk_evidence(m, p)


@numba.njit(cache=True)
def make_room(m: Models, p: Packets, priors: Priors) -> None:
    """Averages two packets, or drops one and keeps what it said, evidence included."""
    k, average = pose_packets.choose(p, priors.coarseness)
    if average:
        pose_packets.merge(p, k, priors.walk_rate)
    else:
        before = m.log_evidence.copy()
        _drop(m, p, k)
        pose_packets.drop(p, k, priors.walk_rate)
    for kind in range(2):
        for i in range(k + 1 if average else k, p.size[0]):
            m.q[kind, i] = m.q[kind, i + 1]
    if not average:
        _solve_all(m, p, priors, 1)
        m.carried[:] += before - m.log_evidence
        m.carried[:] -= np.max(m.carried)
        m.carried[:] = np.maximum(m.carried, -_MEMORY)


@numba.njit(cache=True)
def _restart(m: Models, p: Packets, priors: Priors) -> None:
    """Takes over the moving models that explain more from a fresh start."""
    other = Models(
        m.Y.copy(),
        m.a.copy(),
        m.c.copy(),
        m.q.copy(),
        m.signed,
        m.prior_information,
        m.prior_vector,
        m.prior_value,
        m.prior_Y,
        m.prior_a,
        m.prior_c,
        m.covariance.copy(),
        m.state.copy(),
        m.gain.copy(),
        m.P.copy(),
        m.density.copy(),
        m.log_evidence.copy(),
        m.carried,
    )
    fresh_start(other, p, priors.axis_distance)
    for kind in range(2):
        solve_moving(kind, other, p, priors, _STEPS + 2)
        if other.log_evidence[kind] > m.log_evidence[kind] + 0.1:
            if other.state[kind, 0] * m.state[kind, 0] < 0.0:
                _turn(kind, other)
            _copy_model(kind, other, m)


@numba.njit(cache=True)
def update(
    m: Models, p: Packets, X_FB: Array, R: Array, time: float, priors: Priors, restart: bool
) -> None:
    """Corrects all models with one relative pose, in place.

    Args:
        m: Models.
        p: Packets, the reference at least.
        X_FB: Pose (4, 4) relative to the measured reference.
        R: Its covariance (6, 6), in B.
        time: [s].
        priors: See `Priors`.
        restart: Whether to try a fresh start beside the last solution.
    """
    if p.size[0] == p.time.size:
        make_room(m, p, priors)
    pose_packets.append(p, X_FB, R, time, priors.walk_rate)
    p.walk[0] = min(max(p.walk[0], -_MEMORY), _MEMORY)
    last, dt = p.size[0] - 1, time - p.time[p.size[0] - 2]
    for kind in range(2):
        m.q[kind, last] = m.state[kind, 0] + dt * m.state[kind, 1]
    _solve_all(m, p, priors, _STEPS)
    if restart:
        _restart(m, p, priors)
    for kind in range(2):
        _decide_sign(kind, m)
