"""The evidence of the joint types, from the models near each other's limits.

A slide is the limit of hinges far away, a hinge the limit of screws without pitch. The evidence of
a model's own solution is Laplace's approximation; near a limit the other model's is better.

The models are solved with deviations that are independent from keyframe to keyframe, see
`covariance_floor`. But the deviations by a bent rail or a wrong calibration of a camera are similar
at neighbouring places: a bend is one unlikely event instead of one per keyframe, and no proof of a
hinge far away or of a pitch. Here the deviations are a `deviation_series`, whose coefficients are
marginalised, linearised at the models' own solutions.
"""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.systems.kinematics.evidence.bent_slide import far_evidence
from crossmodal.systems.kinematics.evidence.covariance_floor import (
    FLOORS,
    USUAL_DEVIATION,
    covariance_floor,
    next_index,
)
from crossmodal.systems.kinematics.evidence.deviation_series import (
    PATH_WAVES,
    Waves,
    add_keyframes,
    marginalise,
    no_waves,
    with_path_waves,
)
from crossmodal.systems.kinematics.evidence.wander import (
    GENEROUS,
    NONE,
    SIZES,
    TIMES,
    Wander,
    wander_waves,
)
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    Keyframes,
    copy_keyframes,
    rescale,
    unaveraged,
)
from crossmodal.systems.kinematics.solver.joint_chain import (
    Chain,
    new_chain,
    run_chain,
    solve,
    take_information,
)
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
    JOINTS,
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    SCREW,
    dimension,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    add_priors,
    new_linear,
)
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.joint_solver import Priors, lever, trusted
from crossmodal.systems.kinematics.solver.joint_update import STEPS, restart, solve_all
from crossmodal.systems.kinematics.solver.parameter_priors import (
    hinge_evidence,
    may_be_far,
    pitch_evidence,
)

_ROUGH = 0.25  # Independent deviations beside the smooth ones, as a share of these.
_NEGLIGIBLE = 200.0  # Log evidence below the best one's from which a model is left out, [nat].
# A stored log evidence that is larger by this than the present one is inherited: the model has not
# been solved since, see `joint_update.solve_all`, [nat].
_INHERITED = 10.0


@hot
def _jumps(S: float, J: float, probability: float, kf: Keyframes, chain: Chain) -> float:
    """Log probability of the jumps that are in `chain`, see `run_chain`."""
    count = 0.0
    for k in range(1, kf.size[0]):
        if chain.S[k] > S:
            count += np.log(chain.S[k] / S) / np.log(J / S)
    return count * np.log(probability) if count > 0.0 else 0.0


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
    more = int(waves.variance.size)
    lin, still = new_linear(kf.time.size, more), np.zeros(PARAMETERS + more)
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
    evidence, gain = solve(n, value, chain)
    if kind == RIGID:
        return evidence
    # Of a step that goes too far, only a share can be trusted.
    share = trusted(kind, m.c[kind], m.pitch[kind], chain.step)
    for i in range(n):
        chain.step[i] *= share
    return evidence - gain * (1.0 - share) ** 2


@hot
def _screw_from_hinge(
    m: Models, kf: Keyframes, priors: Priors, rough: Array, waves: Waves, chain: Chain
) -> float:
    """`linear_evidence` of a screw about the hinge's solution, where it has no pitch."""
    screw = int(np.int64(SCREW))  # For a literal, Numba would compile all callees again.
    Y, a, c, pitch = m.Y[screw].copy(), m.a[screw].copy(), m.c[screw].copy(), m.pitch[screw]
    q, inlier, S = m.q[screw].copy(), m.inlier[screw].copy(), m.process_noise[screw]
    assign(m.Y[screw], m.Y[REVOLUTE])
    assign(m.a[screw], m.a[REVOLUTE])
    assign(m.c[screw], m.c[REVOLUTE])
    assign(m.q[screw], m.q[REVOLUTE])
    assign(m.inlier[screw], m.inlier[REVOLUTE])
    m.pitch[screw], m.process_noise[screw] = 0.0, m.process_noise[REVOLUTE]
    value = linear_evidence(screw, m, kf, priors, rough, waves, -1, chain)
    assign(m.Y[screw], Y)
    assign(m.a[screw], a)
    assign(m.c[screw], c)
    assign(m.q[screw], q)
    assign(m.inlier[screw], inlier)
    m.pitch[screw], m.process_noise[screw] = pitch, S
    return value


@hot
def smooth_evidence(
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    errors: Waves,
    evidence: Array,
    covariance: Array,
) -> tuple[float, float]:
    """Writes each model's log evidence (5,) with smooth errors, and covariance (J, N, N).

    It is the evidence of the model's own solution plus its increase with smooth instead of
    independent errors, both linearised there. A model that has not been solved lately keeps its own
    evidence.

    Args:
        deviations: Covariance (6, 6), in B, of those from the path; zero for none.
        errors: Of the measurements, smooth in time.
        covariance: Result; about the models' own solutions, which are not moved.

    Returns:
        The screw's pitch and its variance.
    """
    size, nothing = kf.size[0], no_waves(kf.time.size)
    chain = new_chain(kf.time.size, int(errors.variance.size) + PATH_WAVES)
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    evidence[:], covariance[:] = m.log_evidence, m.covariance
    # A screw that is no likelier than its limit, the hinge, is not solved for itself.
    is_hinge = evidence[SCREW] <= evidence[REVOLUTE]
    # A free motion has no need of a tracker's errors, without which no joint explains anything.
    best = evidence[:JOINTS].max() if errors.variance.size > 0 else evidence.max()
    least, log_det = best - _NEGLIGIBLE, 0.5 * kf.log_det[:size].sum()
    is_smooth = np.trace(deviations) > 0.0
    rough = _ROUGH**2 * deviations if is_smooth else kf.floor
    # Errors of the rotation seem to be jumps until they are known.
    since = -1 if errors.variance.size > 0 else 0
    for kind in range(JOINTS - 1, -1, -1):
        if evidence[kind] < least or (kind == SCREW and is_hinge):
            continue
        independent = linear_evidence(kind, m, kf, priors, unaveraged(kf), nothing, 0, chain)
        if independent < evidence[kind] - m.marginal_evidence[kind] - log_det - _INHERITED:
            continue
        waves = errors
        if is_smooth and kind != RIGID:
            waves = with_path_waves(m.q[kind], size, deviations, errors)
        independently = rough if kind != RIGID else kf.floor
        smooth = linear_evidence(kind, m, kf, priors, independently, waves, since, chain)
        evidence[kind] += smooth - independent
        n = dimension(kind)
        cholesky.inverse(chain.H, covariance[kind], n)
        covariance[kind, :n, :n] += np.outer(chain.step[:n], chain.step[:n])
        if kind == REVOLUTE and is_hinge:
            evidence[SCREW] += smooth - independent
            if errors.variance.size > 0:
                as_screw = _screw_from_hinge(m, kf, priors, rough, waves, chain)
                evidence[SCREW] = evidence[REVOLUTE] + as_screw - smooth
                evidence[SCREW] += m.marginal_evidence[SCREW] - m.marginal_evidence[REVOLUTE]
                pitch, variance = chain.step[10], chain.H[10, 10] ** -2
                evidence[SCREW] += pitch_evidence(pitch, variance)
        if kind == SCREW:
            evidence[SCREW] -= pitch_evidence(pitch, variance)
            pitch, variance = pitch + chain.step[10], chain.H[10, 10] ** -2
            evidence[SCREW] += pitch_evidence(pitch, variance)
    return pitch, variance


def bend(m: Models, kf: Keyframes, priors: Priors, deviations: Array, errors: Waves) -> float:
    """See `far_evidence`; the arguments are those of `smooth_evidence`."""
    waves, rough = errors, kf.floor
    if np.trace(deviations) > 0.0:
        rough = _ROUGH**2 * deviations
        waves = with_path_waves(m.q[PRISMATIC], int(kf.size[0]), deviations, errors)
    lin = new_linear(kf.time.size, int(waves.variance.size))
    add_keyframes(BENT_SLIDE, m, kf, rough, waves, lin)
    return far_evidence(m, kf, priors, waves, lin)


_UNUSUAL = 5.0  # Prior log odds against smooth deviations, [nat].
# Of `FLOORS`; with the largest a ball joint would be a hinge with smooth deviations.
DEVIATIONS = len(FLOORS) - 1
_LEAST_GAIN = 0.5  # Least gain in log probability by other deviations, [nat].
_AHEAD = 3.0  # Log evidence over the slide's from which a hinge's own solution counts, [nat].
_PRUNING_THRESHOLD = 20.0  # Log evidence of a slide below the best one's, [nat].


def _count_limits(
    evidence: Array,
    pitch: float,
    variance: float,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    errors: Waves,
) -> None:
    """Counts screws of next to no pitch as hinges, and bent slides as hinges far away, in place.

    That far away a pitch makes no difference.
    """
    hinge = evidence[SCREW] + hinge_evidence(pitch, variance, priors.hinge_pitch)
    evidence[REVOLUTE] = max(evidence[REVOLUTE], hinge)
    slide = evidence[PRISMATIC]
    matters = evidence.max() - _PRUNING_THRESHOLD < slide and evidence[REVOLUTE] < slide + _AHEAD
    if matters and priors.far_axes and may_be_far(kf):
        far = slide + bend(m, kf, priors, deviations, errors)
        evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
        evidence[SCREW] = max(evidence[SCREW], far)


def _evidence_with(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, errors: Waves
) -> tuple[Array, Array]:
    """`type_evidence` if the errors are these for certain; see `smooth_evidence`."""
    if np.trace(deviations) == 0.0 and errors.variance.size == 0 and kf.wander[0] == 0.0:
        evidence, covariance = m.log_evidence.copy(), m.covariance.copy()
        pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    else:
        evidence, covariance = np.empty(m.log_evidence.size), np.empty(m.covariance.shape)
        pitch, variance = smooth_evidence(m, kf, priors, deviations, errors, evidence, covariance)
    _count_limits(evidence, pitch, variance, m, kf, priors, deviations, errors)
    return evidence, covariance


NO_GAIN = np.full((2, JOINTS), -np.inf)  # Of a wander that nobody has looked for.


def type_evidence(
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    wander: Wander = NONE,
    gain: Array = NO_GAIN,
    log_odds: float = 0.0,
) -> tuple[Array, Array]:
    """Log evidence (5,) of each type, and covariance (J, N, N) of each model's theta.

    Errors are independent, or smooth along the path, or smooth in time, weighted by the evidence.
    Smooth deviations from a path are less common, the more so the larger they are than the usual
    deviations of joints.

    Args:
        deviations: Covariance (6, 6), in B, of smooth deviations from the path; zero for none.
        wander: The likeliest but none.
        gain: (2, J) log evidence of each joint with it over that of all without it, and of itself
            without it, as they were when last solved with it; for models that were solved without.
        log_odds: Prior log odds of it against none, [nat].
    """
    evidence, covariance = _with_deviations(m, kf, priors, deviations, no_waves(kf.time.size))
    if wander != NONE and kf.wander[0] > 0.0:
        errors = wander_waves(wander, kf)
        smooth, C = _with_deviations(m, kf, priors, deviations, errors)
        return _mixed(evidence, covariance, smooth + log_odds + wander.log_prior, C)
    if wander != NONE:
        # From a solution without these errors, one with them is too far to be linearised.
        before = np.minimum(
            np.logaddexp.reduce(evidence[:JOINTS]) + gain[0], evidence[:JOINTS] + gain[1]
        )
        of_joints = before + log_odds + wander.log_prior
        evidence[:JOINTS] = np.logaddexp(evidence[:JOINTS], of_joints)
    return evidence, covariance


def _mixed(
    evidence: Array, covariance: Array, other: Array, other_covariance: Array
) -> tuple[Array, Array]:
    """Evidence and covariance of a mixture of two hypotheses; see `type_evidence`."""
    total, covariance = np.logaddexp(evidence, other), covariance.copy()
    for kind in range(JOINTS):
        p = np.exp(other[kind] - total[kind])
        covariance[kind] = p * other_covariance[kind] + (1.0 - p) * covariance[kind]
    return total, covariance


def _with_deviations(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, errors: Waves
) -> tuple[Array, Array]:
    """`type_evidence` with these errors, and deviations from the path that there may be."""
    evidence, covariance = _evidence_with(m, kf, priors, 0.0 * deviations, errors)
    if np.trace(deviations) == 0.0:
        return evidence, covariance
    unusual = _UNUSUAL + 0.5 * deviations[3, 3] / USUAL_DEVIATION[3]
    smooth, C = _evidence_with(m, kf, priors, deviations, errors)
    return _mixed(evidence, covariance, smooth - unusual, C)


def likelier_deviations(
    m: Models,
    kf: Keyframes,
    index: int,
    tries: int,
    reported: Array,
    scale: Array,
    priors: Priors,
    log_prior: Array,
    wander: Wander = NONE,
) -> int:
    """Index in `FLOORS` of the size of smooth deviations: `index`, or the one that is tried next.

    It is the one under which all keyframes are likelier, whatever the type. The arguments are those
    of `with_likelier_floor` and `type_evidence`.
    """
    other = next_index(index, tries, DEVIATIONS)
    floors = [covariance_floor(i, reported, scale) for i in (index, other)]
    errors = wander_waves(wander if kf.wander[0] > 0.0 else NONE, kf)
    evidence = [_with_deviations(m, kf, priors, floor, errors)[0] for floor in floors]
    now, then = np.logaddexp.reduce(np.array(evidence) + log_prior, axis=1)
    return other if then - now > _LEAST_GAIN else index


def likelier_wander(
    m: Models,
    kf: Keyframes,
    before: Wander,
    smallest: int,
    deviations: list[Array],
    tries: int,
    priors: Priors,
    log_prior: Array,
    log_odds: float,
) -> tuple[Models, Keyframes, Wander, Array]:
    """The likeliest wander, and the models and keyframes, solved with it where it is likely.

    It is that under which the joints explain most, whichever that is. If rotations err, joints
    found without that explain nothing, so that they are solved with a generous error before all are
    compared.

    Args:
        m: Models; not changed.
        kf: Keyframes; not changed. All must have been explained by free motions.
        before: The likeliest before; `NONE` if nobody has looked.
        smallest: Index of the smallest size that counts; those below are within what is reported.
        deviations: Covariances (6, 6) of smooth deviations from the path, the first of them zero:
            what these explain is no error of rotations.
        tries: How many there were, by which the time is chosen that is tried beside.
        log_odds: Of each wander against none, before anything was measured.

    Returns:
        Models, keyframes, the likeliest wander, and its `gain`, see `type_evidence`.
    """
    start = Wander(max(smallest, GENEROUS.at_size), GENEROUS.at_time)
    start = before if before.at_size >= smallest else start
    is_used = kf.wander[0] > 0.0
    models, frames = (m, kf) if is_used else _solved_with(start, m, kf, priors)
    values: dict[Wander, float] = {}

    def total(of_joints: Array) -> float:
        return float(np.logaddexp.reduce(of_joints + log_prior[:JOINTS]))

    def evidence(wander: Wander, of_path: Array) -> Array:
        at, errors = (models, frames) if wander != NONE else (m, kf), wander_waves(wander, kf)
        of_joints = _with_deviations(*at, priors, of_path, errors)[0][:JOINTS]
        return np.asarray(of_joints - 0.5 * at[1].log_det[: at[1].size[0]].sum())

    def value(wander: Wander) -> float:
        if wander not in values:
            values[wander] = total(evidence(wander, deviations[0])) + wander.log_prior
        return values[wander]

    sizes = range(smallest, len(SIZES))
    best = max([start, *(Wander(n, tries % len(TIMES)) for n in sizes)], key=value)
    best = start if value(best) < value(start) + _LEAST_GAIN else best
    while True:
        beside = [w for w in best.neighbours if w.at_size in sizes]
        other = max(beside, key=value)
        if value(other) < value(best) + _LEAST_GAIN:
            break
        best = other
    log_odds += best.log_prior
    is_close = log_odds + total(evidence(best, deviations[0])) > value(NONE) - _PRUNING_THRESHOLD
    of_paths = deviations if is_close else deviations[:1]
    without = max((evidence(NONE, of_path) for of_path in of_paths), key=total)
    with_it = max((evidence(best, of_path) for of_path in of_paths), key=total)
    gain = with_it - np.array([np.repeat(np.logaddexp.reduce(without), JOINTS), without])
    log_odds += total(with_it) - total(without)
    is_better = log_odds > (-_LEAST_GAIN if is_used else _LEAST_GAIN)
    wanted = best if is_better else NONE
    for at in ((m, kf), (models, frames)):
        if at[1].wander[0] == wanted.variance:
            return *at, best, gain
    return *_solved_with(wanted, models, kf, priors), best, gain


def _solved_with(w: Wander, m: Models, kf: Keyframes, priors: Priors) -> tuple[Models, Keyframes]:
    """Copies with another wander, solved again."""
    models, frames = Models(*[x.copy() for x in m]), copy_keyframes(kf)
    rescale(frames, np.ones(6), frames.floor.copy(), priors.outliers, w.variance)
    solve_all(models, frames, priors, STEPS, True)
    restart(models, frames, priors, True)
    return models, frames
