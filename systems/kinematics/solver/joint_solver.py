"""The solution of the joint models for all keyframes in memory, compiled.

The moving models are solved by Gauss-Newton steps from the last solution, for each of several
densities of the process noise, and the rigid one likewise; a free motion is filtered.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.vectors import transport
from crossmodal.systems.kinematics.keyframes.pose_keyframes import RECENT, Keyframes
from crossmodal.systems.kinematics.solver.free_motion import FreeMotion
from crossmodal.systems.kinematics.solver.joint_chain import (
    Chain,
    new_chain,
    run_chain,
    smooth,
    solve,
    take_information,
)
from crossmodal.systems.kinematics.solver.joint_geometry import (
    PARAMETERS,
    PRISMATIC,
    RIGID,
    SCREW,
    dimension,
    retract,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    Linear,
    linearise,
    new_linear,
)
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.parameter_priors import may_be_far, pitch_evidence

CONVERGED = 0.1  # Gain in log likelihood below which no further step is made, [nat].
SHORTER = 0.3  # Share of a step that is tried where the whole of it has lost likelihood.
PROMISED = 1.0  # Most gain that the last step may add to the evidence unverified, [nat].
_SLOWLY = 0.2  # Ratio of a slow motion's first speed to `speed`.
_UNLIKELY = 12.0  # Log evidence below the best from which a density is not solved for again, [nat].
_TILT = 0.7  # Most that one step may tilt an axis, [rad].
_SHIFT = 0.5  # Most that one step may move an axis, as a share of its distance.


class Priors(NamedTuple):
    """What is known of joints before anything is measured, and of the measurements' errors.

    Attributes:
        process_noise: Densities (n,) of the child's acceleration to choose from, [m^2/s^3].
        jump_noise: That of a step in which its velocity jumps, [m^2/s^3].
        jumps: Probability of such a step.
        speed: Standard deviation of the child's first speed, [m/s].
        radius: Lever of a rotation about the child itself, [m].
        axis_distance: Standard deviation from child to axis, per direction, [m].
        far_axes: Whether it may be farther away, see `parameter_priors`.
        hinge_pitch: Standard deviation of a hinge's own pitch, see `parameter_priors`, [m/rad].
        free: How a body moves that no joint holds.
        outliers: (7,) share of outliers among the measurements, and the variances of what they are
            off by, [rad^2, m^2].
        coarseness: See `pose_keyframes.choose`.
        white_share: Of each measurement's variance, one for white noise; see `error_shares`.
        correlated_share: Of it, likewise; such an error cannot be told from motion.
    """

    process_noise: Array
    jump_noise: float
    jumps: float
    speed: float
    radius: float
    axis_distance: float
    far_axes: bool
    hinge_pitch: float
    free: FreeMotion
    outliers: Array
    coarseness: float
    white_share: float
    correlated_share: float


@hot
def lever(kind: int, m: Models, priors: Priors) -> float:
    """How far the child moves per unit of q, [m] or [m/rad]; for a rotation about itself, too."""
    if kind == PRISMATIC:
        return 1.0
    c = m.c[kind]
    return np.sqrt(priors.radius**2 + c[0] ** 2 + c[1] ** 2 + c[2] ** 2 + m.pitch[kind] ** 2)


@hot
def _copy(chain: Chain, to: Chain) -> None:
    """Copies a solution."""
    assign(to.m, chain.m)
    assign(to.M, chain.M)
    assign(to.P, chain.P)
    assign(to.S, chain.S)
    assign(to.H, chain.H)
    assign(to.step, chain.step)


@hot
def _solve_densities(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    lin: Linear,
    evidences: Array,
    best: Chain,
    trial: Chain,
) -> tuple[float, float, float, float, float]:
    """Solves for every density of the process noise; the best solution stays in `best`.

    With the likeliest density also for a motion that begins slowly, which is as likely as one that
    does not.

    `evidences` (n,) are those at the last linearisation, all alike at first; they are overwritten,
    but for densities that were unlikely then, which are left out.

    Returns:
        Log evidence with density and first speed marginalised, the best density S, with it the
        standard deviation of the first rate, its log likelihood and gain.
    """
    n, by, still = dimension(kind), lever(kind, m, priors), np.zeros(PARAMETERS)
    total, top, best_S, best_value, best_gain = 0.0, -np.inf, 0.0, 0.0, 0.0
    q, speed, J = m.q[kind], priors.speed / by, priors.jump_noise / by**2
    least = evidences.max() - _UNLIKELY
    for i in range(evidences.size):
        if evidences[i] < least:
            continue
        S = priors.process_noise[i] / by**2
        value = run_chain(n, S, J, priors.jumps, speed, 1.0, q, kf, lin, still, 0, trial)
        evidence, gain = solve(n, value, trial)
        evidences[i] = evidence
        if evidence > top:
            total = total * np.exp(top - evidence) + 1.0
            top, best_S, best_value, best_gain = evidence, S, value, gain
            _copy(trial, best)
        else:
            total += np.exp(evidence - top)
    evidence = top + np.log(total / priors.process_noise.size)
    slowly = _SLOWLY * speed
    value = run_chain(n, best_S, J, priors.jumps, slowly, 1.0, q, kf, lin, still, 0, trial)
    other, gain = solve(n, value, trial)
    evidence += np.logaddexp(0.0, other - top) - np.log(2.0)
    if other <= top:
        return evidence, best_S, speed, best_value, best_gain
    _copy(trial, best)
    return evidence, best_S, slowly, value, gain


@hot
def _track(
    kind: int, m: Models, kf: Keyframes, priors: Priors, lin: Linear, best: Chain, trial: Chain
) -> float:
    """Filters q anew with the white share of the errors only, into `best`; returns its density S.

    A correlated error cannot be averaged away, so that q follows the measurements and its variance
    gets the correlated share on top. S is the density under which the newest keyframes are
    likeliest, whatever a long motion before them was like. The covariance of theta is not changed.
    """
    n, by, q = dimension(kind), lever(kind, m, priors), m.q[kind].copy()
    speed, since = priors.speed / by, kf.size[0] - RECENT
    J, jumps, white = priors.jump_noise / by**2, priors.jumps, priors.white_share
    top, best_S = -np.inf, 0.0
    for density in priors.process_noise:
        S = density / by**2
        value = run_chain(n, S, J, jumps, speed, white, q, kf, lin, best.step, since, trial)
        if value > top:
            top, best_S = value, S
            assign(best.m, trial.m)
            assign(best.M, trial.M)
            assign(best.P, trial.P)
    best.P[0] += priors.correlated_share / lin.alpha[kf.size[0] - 1]
    return best_S


@hot
def _turn_rows(Q: Array, first: int, x: Array) -> None:
    """Turns rows `first` and the next of `x` by Q (2, 2), in place."""
    for k in range(x.shape[1]):
        u, v = x[first, k], x[first + 1, k]
        x[first, k] = Q[0, 0] * u + Q[0, 1] * v
        x[first + 1, k] = Q[1, 0] * u + Q[1, 1] * v


@hot
def _transport(kind: int, a: Array, m: Models) -> None:
    """Refers the posterior, in place, to the basis at the model's axis instead of that at `a`."""
    Q = np.empty((2, 2))
    transport(a, m.a[kind], Q)
    for first in range(6, dimension(kind) - 1, 2):
        _turn_rows(Q, first, m.covariance[kind])
        _turn_rows(Q, first, m.covariance[kind].T)
        _turn_rows(Q, first, m.gain[kind].T)


@hot
def _store(kind: int, m: Models, chain: Chain) -> None:
    """Keeps the posterior of the newest keyframe."""
    n = dimension(kind)
    cholesky.inverse(chain.H, m.covariance[kind], n)
    for i in range(2):
        m.state[kind, i] = chain.m[i]
        for j in range(n):
            m.gain[kind, i, j] = chain.M[i, j]
            m.state[kind, i] += chain.M[i, j] * chain.step[j]
    m.P[kind, 0, 0], m.P[kind, 1, 1] = chain.P[0], chain.P[2]
    m.P[kind, 0, 1] = m.P[kind, 1, 0] = chain.P[1]


@hot
def trusted(kind: int, c: Array, pitch: float, step: Array) -> float:
    """The share of a step within which the linearisation can be trusted."""
    tilt = np.sqrt(step[6] ** 2 + step[7] ** 2)
    share = 1.0 if tilt < _TILT else _TILT / tilt
    if turns(kind):
        shift = np.sqrt(step[8] ** 2 + step[9] ** 2 + step[10] ** 2)
        limit = _SHIFT * (0.3 + np.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2 + pitch**2))
        share = min(share, 1.0 if shift < limit else limit / shift)
    return share


@hot
def move(kind: int, m: Models, priors: Priors, q: Array, step: Array) -> None:
    """Moves theta by `step`; m.q is already moved from `q` by its linear share of the step.

    The change of m.q is scaled by the lever, so that a path keeps its length if the axis recedes.
    """
    before = lever(kind, m, priors)
    m.pitch[kind] = retract(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], step)
    share = before / lever(kind, m, priors)
    for i in range(q.size):
        m.q[kind, i] = q[i] + share * (m.q[kind, i] - q[i])


@hot
def solve_moving(
    kind: int, m: Models, kf: Keyframes, priors: Priors, steps: int, temper: float
) -> None:
    """Gauss-Newton with step shortening on theta and all q; stores posterior and evidence.

    The last step is not verified by another linearisation, so that it is taken only if its gain is
    next to nothing: along a valley, such as that of an axis far away, a step of small gain can go
    far and lose much.

    Args:
        kind: One of `MOVING`.
        steps: Linearisations at most, two or more.
    """
    lin = new_linear(kf.time.size)
    best, trial = new_chain(kf.time.size), new_chain(kf.time.size)
    previous, q_previous = -np.inf, m.q[kind].copy()
    Y, a, c, pitch = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy(), m.pitch[kind]
    step, dq = np.zeros(PARAMETERS), np.zeros(kf.time.size)
    evidences, accepted = np.zeros((2, priors.process_noise.size))
    # Where rotations err smoothly, they turn a slide as a far hinge does.
    far = priors.far_axes and kf.wander[0] == 0.0 and may_be_far(kf)
    for i in range(steps):
        linearise(kind, m, kf, priors.axis_distance, far, priors.outliers[0], temper, lin)
        evidence, S, sigma_v, value, gain = _solve_densities(
            kind, m, kf, priors, lin, evidences, best, trial
        )
        if i < steps - 1 and value < previous:
            share = SHORTER if i < steps - 2 else 0.0
            step *= share
            assign(m.Y[kind], Y)
            assign(m.a[kind], a)
            assign(m.c[kind], c)
            assign(m.q[kind], q_previous + share * dq)
            assign(evidences, accepted)
            m.pitch[kind] = pitch
            move(kind, m, priors, q_previous, step)
            continue
        assign(accepted, evidences)
        assign(Y, m.Y[kind])
        assign(a, m.a[kind])
        assign(c, m.c[kind])
        assign(q_previous, m.q[kind])
        previous, pitch = value, m.pitch[kind]
        last = i >= steps - 2 or gain < CONVERGED
        assign(best.step, trusted(kind, m.c[kind], pitch, best.step) * best.step)
        if last and gain >= CONVERGED:
            best.step[:] = 0.0
        assign(step, best.step)
        smooth(dimension(kind), best.S, sigma_v, q_previous, kf, lin, step, m.q[kind])
        if last and priors.white_share < 1.0:
            q_smooth = m.q[kind].copy()
            assign(m.q[kind], q_previous)
            S = _track(kind, m, kf, priors, lin, best, trial)
            assign(m.q[kind], q_smooth)
        dq = m.q[kind] - q_previous
        move(kind, m, priors, q_previous, step)
        if last:
            evidence -= max(gain - PROMISED, 0.0)
            m.log_evidence[kind], m.process_noise[kind] = evidence + m.marginal_evidence[kind], S
            _store(kind, m, best)
            _transport(kind, a, m)
            if kind == SCREW:
                m.log_evidence[kind] += pitch_evidence(m.pitch[kind], m.covariance[kind, 10, 10])
            break


@hot
def solve_rigid(m: Models, kf: Keyframes, priors: Priors) -> None:
    """Solves the rigid model, which is nearly linear."""
    temper = 1.0
    rigid = int(np.int64(RIGID))  # For a literal, Numba would compile all callees again.
    lin, chain = new_linear(kf.time.size), new_chain(kf.time.size)
    for _ in range(2):
        linearise(rigid, m, kf, priors.axis_distance, False, priors.outliers[0], temper, lin)
        take_information(dimension(rigid), lin, chain)
        evidence, gain = solve(dimension(rigid), lin.value[0], chain)
        retract(rigid, m.Y[RIGID], m.a[RIGID], m.c[RIGID], m.pitch[RIGID], chain.step)
        m.log_evidence[RIGID] = evidence + m.marginal_evidence[RIGID]
        if gain < CONVERGED:
            break
    cholesky.inverse(chain.H, m.covariance[RIGID], dimension(rigid))
