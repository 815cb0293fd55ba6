"""The joint models solved with smooth errors, and their evidence, compiled.

The models are solved with deviations that are independent from keyframe to keyframe, see
`covariance_floor`. But the deviations by a bent rail or a wrong calibration of a camera are similar
at neighbouring places: a bend is one unlikely event instead of one per keyframe, and no proof of a
hinge far away or of a pitch. Here the deviations are a `deviation_series`, whose coefficients are
marginalised, linearised at the models' own solutions. With errors of a tracker's rotations, which
are larger, the models are solved anew.
"""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.systems.kinematics.evidence.deviation_series import (
    PATH_WAVES,
    Waves,
    add_coefficients,
    add_keyframes,
    marginalise,
    no_waves,
    with_path_waves,
)
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes, unaveraged
from crossmodal.systems.kinematics.solver.joint_chain import (
    Chain,
    new_chain,
    run_chain,
    smooth,
    solve,
    take_information,
)
from crossmodal.systems.kinematics.solver.joint_geometry import (
    JOINTS,
    PARAMETERS,
    REVOLUTE,
    RIGID,
    SCREW,
    dimension,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    Linear,
    add_priors,
    clear,
    new_linear,
)
from crossmodal.systems.kinematics.solver.joint_models import Models, copy_models
from crossmodal.systems.kinematics.solver.joint_solver import (
    CONVERGED,
    PROMISED,
    SHORTER,
    Priors,
    lever,
    move,
    trusted,
)
from crossmodal.systems.kinematics.solver.parameter_priors import may_be_far, pitch_evidence

_NEGLIGIBLE = 200.0  # Log evidence below the best one's from which a model is left out, [nat].
# A stored log evidence that is larger by this than the present one is inherited: the model has not
# been solved since, see `joint_update.solve_all`, [nat].
_INHERITED = 10.0
_ROUNDS = 6  # Most linearisations with smooth errors of the measurements.


@hot
def _jumps(S: float, J: float, probability: float, kf: Keyframes, chain: Chain) -> float:
    """Log probability of the jumps that are in `chain`, see `run_chain`."""
    count = 0.0
    for k in range(1, kf.size[0]):
        if chain.S[k] > S:
            count += np.log(chain.S[k] / S) / np.log(J / S)
    return count * np.log(probability) if count > 0.0 else 0.0


@hot
def _step(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    rough: Array,
    waves: Waves,
    since: int,
    lin: Linear,
    chain: Chain,
) -> tuple[float, float]:
    """Linearises and solves a model; returns log evidence and gain, see `linear_evidence`."""
    more = int(waves.variance.size)
    still = np.zeros(PARAMETERS + more)
    clear(lin)
    add_keyframes(kind, m, kf, rough, waves, lin)
    far = priors.far_axes and may_be_far(kf)
    add_priors(kind, m, priors.axis_distance, far, lin)
    n, value = dimension(kind), lin.value[0]
    if kind == RIGID:
        take_information(n + more, lin, chain)
    else:
        by = lever(kind, m, priors)
        S, J, sigma_v = m.process_noise[kind], priors.jump_noise / by**2, priors.speed / by
        value = run_chain(
            n + more, S, J, priors.jumps, sigma_v, 1.0, m.q[kind], kf, lin, still, since, chain
        )
        if since < 0:
            value += _jumps(S, J, priors.jumps, kf, chain)
    value += marginalise(n, waves, chain)
    return solve(n, value, chain)


@hot
def linear_evidence(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    rough: Array,
    waves: Waves,
    since: int,
    chain: Chain,
) -> float:
    """Log evidence of a model about its own solution; solves `chain`.

    Args:
        rough: Covariance (6, 6) of each keyframe's independent error beside its noise.
        waves: Of errors that are smooth.
        since: Negative to go on with the jumps that are in `chain`, see `run_chain`; else zero.
    """
    lin = new_linear(kf.time.size, int(waves.variance.size))
    evidence, gain = _step(kind, m, kf, priors, rough, waves, since, lin, chain)
    if kind == RIGID:
        return evidence
    # Of a step that goes too far, only a share can be trusted.
    share = trusted(kind, m.c[kind], m.pitch[kind], chain.step)
    for i in range(dimension(kind)):
        chain.step[i] *= share
    return evidence - gain * (1.0 - share) ** 2


@hot
def _solved_evidence(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    rough: Array,
    waves: Waves,
    since: int,
    chain: Chain,
) -> float:
    """Like `linear_evidence`, at the moving model's solution with these errors; it is moved there.

    Its posterior is that with these errors, too.
    """
    n, more = dimension(kind), int(waves.variance.size)
    lin, before, evidence, gain = new_linear(kf.time.size, more), -np.inf, -np.inf, 0.0
    Y, a, c, pitch = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy(), m.pitch[kind]
    q, dq, step = m.q[kind].copy(), np.zeros(kf.time.size), chain.step.copy()
    for i in range(_ROUNDS):
        evidence, gain = _step(kind, m, kf, priors, rough, waves, since, lin, chain)
        last = i == _ROUNDS - 1
        if evidence - gain < before:
            # As it was, on the last round, or with a shorter step.
            share = 0.0 if last or i == _ROUNDS - 2 else SHORTER
            step *= share
            dq *= share
            assign(m.Y[kind], Y)
            assign(m.a[kind], a)
            assign(m.c[kind], c)
            assign(m.q[kind], q + dq)
            m.pitch[kind] = pitch
            move(kind, m, priors, q, step)
            continue
        before = evidence - gain
        if last or gain < CONVERGED:
            break
        assign(Y, m.Y[kind])
        assign(a, m.a[kind])
        assign(c, m.c[kind])
        assign(q, m.q[kind])
        pitch, sigma_v = m.pitch[kind], priors.speed / lever(kind, m, priors)
        share = trusted(kind, m.c[kind], pitch, chain.step)
        for j in range(n):
            chain.step[j] *= share
        add_coefficients(n, waves, chain)
        smooth(n + more, chain.S, sigma_v, q, kf, lin, chain.step, m.q[kind])
        dq[:], step[:] = m.q[kind] - q, chain.step
        move(kind, m, priors, q, step)
    chain.step[:n] = 0.0
    add_coefficients(n, waves, chain)
    store_posterior(kind, m, waves, chain)
    return evidence - max(gain - PROMISED, 0.0)


@hot
def store_posterior(kind: int, m: Models, waves: Waves, chain: Chain) -> None:
    """Keeps the posterior of the newest keyframe, after `add_coefficients` with no step of theta.

    What the coefficients leave uncertain of q is part of its covariance given theta.
    """
    n, more = dimension(kind), int(waves.variance.size)
    cholesky.inverse(chain.H, m.covariance[kind], n)
    S, rows = chain.H[n : n + more, n : n + more].copy(), chain.M[:, n:].copy()
    for i in range(2):
        m.state[kind, i] = chain.m[i]
        for j in range(more):
            m.state[kind, i] += rows[i, j] * chain.step[n + j]
        cholesky.forward(S, rows[i], more)
        for j in range(n):
            m.gain[kind, i, j] = chain.M[i, j]
            for k in range(more):
                m.gain[kind, i, j] -= rows[i, k] * chain.H[n + k, j]
        for j in range(i + 1):
            m.P[kind, i, j] = chain.P[i + j]
            for k in range(more):
                m.P[kind, i, j] += rows[i, k] * rows[j, k]
    m.P[kind, 0, 1] = m.P[kind, 1, 0]


@hot
def _start_screw(m: Models) -> None:
    """The screw begins as the hinge, without a pitch, in place."""
    screw = int(np.int64(SCREW))  # For a literal, Numba would compile all callees again.
    assign(m.Y[screw], m.Y[REVOLUTE])
    assign(m.a[screw], m.a[REVOLUTE])
    assign(m.c[screw], m.c[REVOLUTE])
    assign(m.q[screw], m.q[REVOLUTE])
    assign(m.inlier[screw], m.inlier[REVOLUTE])
    m.pitch[screw], m.process_noise[screw] = 0.0, m.process_noise[REVOLUTE]


@hot
def _start_nearer(
    m: Models,
    kf: Keyframes,
    priors: Priors,
    rough: Array,
    waves: Waves,
    since: int,
    chain: Chain,
) -> None:
    """The screw begins where it explains more: as it is, or as the hinge; in place."""
    screw = int(np.int64(SCREW))
    lin = new_linear(kf.time.size, int(waves.variance.size))
    S, own = chain.S.copy(), copy_models(m)
    evidence, gain = _step(screw, m, kf, priors, rough, waves, since, lin, chain)
    _start_screw(m)
    of_hinge, gain_of_hinge = _step(screw, m, kf, priors, rough, waves, since, lin, chain)
    if evidence - gain > of_hinge - gain_of_hinge:
        assign(m.Y[screw], own.Y[screw])
        assign(m.a[screw], own.a[screw])
        assign(m.c[screw], own.c[screw])
        assign(m.q[screw], own.q[screw])
        assign(m.inlier[screw], own.inlier[screw])
        m.pitch[screw], m.process_noise[screw] = own.pitch[screw], own.process_noise[screw]
    assign(chain.S, S)


@hot
def smooth_evidence(
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    rough: Array,
    errors: Waves,
    evidence: Array,
    at: Models,
) -> tuple[float, float]:
    """Writes each model's log evidence (5,) with smooth errors, and its posterior into `at`.

    It is the evidence of the model's own solution plus its increase with smooth instead of
    independent errors. A model that has not been solved lately keeps its own evidence.

    Args:
        deviations: Covariance (6, 6), in B, of those from the path; zero for none. With these
            alone a model stays where it is, but for its covariance.
        rough: Covariance (6, 6) of each keyframe's independent error beside its noise.
        errors: Of the measurements, smooth in time. With these it is solved anew.
        at: Result; a copy of `m`.

    Returns:
        The screw's pitch and its variance.
    """
    size, nothing = kf.size[0], no_waves(kf.time.size)
    chain = new_chain(kf.time.size, int(errors.variance.size) + PATH_WAVES)
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    evidence[:] = m.log_evidence
    # A screw that is no likelier than its limit, the hinge, is not solved for itself.
    is_hinge = evidence[SCREW] <= evidence[REVOLUTE]
    # A free motion has no need of a tracker's errors, without which no joint explains anything.
    wanders, moves = errors.variance.size > 0, kf.wander[0] > 0.0
    since = -1 if wanders else 0  # Errors of the rotation seem to be jumps until they are known.
    best = evidence[:JOINTS].max() if wanders else evidence.max()
    least, log_det = best - _NEGLIGIBLE, 0.5 * kf.log_det[:size].sum()
    is_smooth = np.trace(deviations) > 0.0
    for kind in range(JOINTS):
        if evidence[kind] < least or (kind == SCREW and is_hinge):
            continue
        independent = linear_evidence(kind, m, kf, priors, unaveraged(kf), nothing, 0, chain)
        if independent < evidence[kind] - m.marginal_evidence[kind] - log_det - _INHERITED:
            continue
        waves = errors
        if is_smooth and kind != RIGID:
            waves = with_path_waves(m.q[kind], size, deviations, errors)
        independently = rough if kind != RIGID else kf.floor
        if kind == SCREW and moves:
            _start_nearer(at, kf, priors, independently, waves, since, chain)
        if moves and kind != RIGID:
            value = _solved_evidence(kind, at, kf, priors, independently, waves, since, chain)
        else:
            value = linear_evidence(kind, m, kf, priors, independently, waves, 0, chain)
            n = dimension(kind)
            cholesky.inverse(chain.H, at.covariance[kind], n)
            at.covariance[kind, :n, :n] += np.outer(chain.step[:n], chain.step[:n])
        evidence[kind] += value - independent
        if kind == REVOLUTE and is_hinge:
            evidence[SCREW] += value - independent
            if moves:
                _start_screw(at)
                screw = int(np.int64(SCREW))  # For a literal, Numba would compile all again.
                as_screw = _solved_evidence(screw, at, kf, priors, rough, waves, since, chain)
                evidence[SCREW] = evidence[REVOLUTE] + as_screw - value
                evidence[SCREW] += m.marginal_evidence[SCREW] - m.marginal_evidence[REVOLUTE]
                pitch, variance = at.pitch[SCREW], chain.H[10, 10] ** -2
                evidence[SCREW] += pitch_evidence(pitch, variance)
        if kind == SCREW:
            evidence[SCREW] -= pitch_evidence(pitch, variance)
            pitch = at.pitch[SCREW] if moves else pitch + chain.step[10]
            variance = chain.H[10, 10] ** -2
            evidence[SCREW] += pitch_evidence(pitch, variance)
    return pitch, variance
