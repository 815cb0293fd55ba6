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
    add_keyframes,
    marginalise,
    new_series,
)
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
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
    Linear,
    add_priors,
    clear,
    new_linear,
)
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.joint_solver import Priors, lever, trusted
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
def _evidence(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    rough: Array,
    lin: Linear,
    chain: Chain,
) -> float:
    """Log evidence of a model about its own solution; solves `chain`.

    With smooth deviations, if their covariance is not zero; a body at rest has none.
    """
    clear(lin)
    zero, still = int(np.int64(0)), np.zeros(PARAMETERS)
    series, is_smooth = new_series(), np.trace(deviations) > 0.0 and kind != RIGID
    add_keyframes(kind, m, kf, rough, is_smooth, lin, series)
    if is_smooth:
        marginalise(dimension(kind), deviations, series, lin)
    far = priors.far_axes and may_be_far(kf)
    add_priors(kind, m, priors.axis_distance, far, lin)
    n, value = dimension(kind), lin.value[0]
    if kind == RIGID:
        take_information(n, lin, chain)
    else:
        by = lever(kind, m, priors)
        S, J, sigma_v = m.process_noise[kind], priors.jump_noise / by**2, priors.speed / by
        value = run_chain(
            n, S, J, priors.jumps, sigma_v, 1.0, m.q[kind], kf, lin, still, zero, chain
        )
    evidence, gain = solve(n, value, chain)
    if kind == RIGID:
        return evidence
    # Of a step that goes too far, only a share can be trusted.
    share = trusted(kind, m.c[kind], m.pitch[kind], chain.step)
    assign(chain.step, share * chain.step)
    return evidence - gain * (1.0 - share) ** 2


def smooth_evidence(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, evidence: Array, covariance: Array
) -> tuple[float, float]:
    """Writes each model's log evidence (5,) with smooth deviations, and covariance (J, N, N).

    It is the evidence of the model's own solution plus its increase with smooth instead of
    independent deviations, both linearised there. A model that has not been solved lately keeps
    its own evidence.

    Args:
        deviations: Their covariance (6, 6), in B.
        covariance: Result; about the models' own solutions, which are not moved.

    Returns:
        The screw's pitch and its variance.
    """
    capacity, size = kf.time.size, kf.size[0]
    lin, chain, none = new_linear(capacity), new_chain(capacity), 0.0 * deviations
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    evidence[:], covariance[:] = m.log_evidence, m.covariance
    # A screw that is no likelier than its limit, the hinge, is not solved for itself.
    is_hinge = evidence[SCREW] <= evidence[REVOLUTE]
    least, log_det = evidence.max() - _NEGLIGIBLE, 0.5 * kf.log_det[:size].sum()
    for kind in range(JOINTS - 1, -1, -1):
        if evidence[kind] < least or (kind == SCREW and is_hinge):
            continue
        independent = _evidence(kind, m, kf, priors, none, kf.floor, lin, chain)
        if independent < evidence[kind] - m.marginal_evidence[kind] - log_det - _INHERITED:
            continue
        smooth = _evidence(kind, m, kf, priors, deviations, _ROUGH**2 * deviations, lin, chain)
        evidence[kind] += smooth - independent
        n = dimension(kind)
        cholesky.inverse(chain.H, covariance[kind], n)
        covariance[kind, :n, :n] += np.outer(chain.step[:n], chain.step[:n])
        if kind == REVOLUTE and is_hinge:
            evidence[SCREW] += smooth - independent
        if kind == SCREW:
            evidence[SCREW] -= pitch_evidence(pitch, variance)
            pitch, variance = pitch + chain.step[10], chain.H[10, 10] ** -2
            evidence[SCREW] += pitch_evidence(pitch, variance)
    return pitch, variance


def bend(m: Models, kf: Keyframes, priors: Priors, deviations: Array) -> float:
    """See `far_evidence`; with smooth deviations if their covariance (6, 6) is not zero."""
    lin, series = new_linear(kf.time.size), new_series()
    is_smooth = np.trace(deviations) > 0.0
    rough = _ROUGH**2 * deviations if is_smooth else kf.floor
    add_keyframes(BENT_SLIDE, m, kf, rough, is_smooth, lin, series)
    if is_smooth:
        marginalise(dimension(BENT_SLIDE), deviations, series, lin)
    return far_evidence(m, kf, priors, lin)


_UNUSUAL = 5.0  # Prior log odds against smooth deviations, [nat].
# Of `FLOORS`; with the largest a ball joint would be a hinge with smooth deviations.
_SIZES = len(FLOORS) - 1
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
) -> None:
    """Counts screws of next to no pitch as hinges, and bent slides as hinges far away, in place.

    That far away a pitch makes no difference.
    """
    hinge = evidence[SCREW] + hinge_evidence(pitch, variance, priors.hinge_pitch)
    evidence[REVOLUTE] = max(evidence[REVOLUTE], hinge)
    slide = evidence[PRISMATIC]
    matters = evidence.max() - _PRUNING_THRESHOLD < slide and evidence[REVOLUTE] < slide + _AHEAD
    if matters and priors.far_axes and may_be_far(kf):
        far = slide + bend(m, kf, priors, deviations)
        evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
        evidence[SCREW] = max(evidence[SCREW], far)


def type_evidence(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array
) -> tuple[Array, Array]:
    """Log evidence (5,) of each type, and covariance (J, N, N) of each model's theta.

    Deviations are independent or smooth, weighted by the evidence. Smooth ones are less common, the
    more so the larger they are than the usual deviations of joints.

    Args:
        deviations: Covariance (6, 6), in B, of smooth deviations; zero for none.
    """
    evidence = m.log_evidence.copy()
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    _count_limits(evidence, pitch, variance, m, kf, priors, 0.0 * deviations)
    if np.trace(deviations) == 0.0:
        return evidence, m.covariance.copy()
    unusual = _UNUSUAL + 0.5 * deviations[3, 3] / USUAL_DEVIATION[3]
    smooth, covariance = np.empty(evidence.size), np.empty(m.covariance.shape)
    pitch, variance = smooth_evidence(m, kf, priors, deviations, smooth, covariance)
    for kind in range(JOINTS):
        p = 1.0 / (1.0 + np.exp(min(m.log_evidence[kind] - smooth[kind] + unusual, 50.0)))
        covariance[kind] = p * covariance[kind] + (1.0 - p) * m.covariance[kind]
    _count_limits(smooth, pitch, variance, m, kf, priors, deviations)
    return np.logaddexp(evidence, smooth - unusual), covariance


def likelier_deviations(
    m: Models,
    kf: Keyframes,
    index: int,
    tries: int,
    reported: Array,
    scale: Array,
    priors: Priors,
    log_prior: Array,
) -> int:
    """Index in `FLOORS` of the size of smooth deviations: `index`, or the one that is tried next.

    It is the one under which all keyframes are likelier, whatever the type. The arguments are those
    of `with_likelier_floor`.
    """
    other = next_index(index, tries, _SIZES)
    floors = [covariance_floor(i, reported, scale) for i in (index, other)]
    evidence = [type_evidence(m, kf, priors, floor)[0] for floor in floors]
    now, then = np.logaddexp.reduce(np.array(evidence) + log_prior, axis=1)
    return other if then - now > _LEAST_GAIN else index
