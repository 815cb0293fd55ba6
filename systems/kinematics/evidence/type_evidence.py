"""The evidence of the joint types, from the models near each other's limits.

A slide is the limit of hinges far away, a hinge the limit of screws without pitch. The evidence of
a model's own solution is Laplace's approximation; near a limit the other model's is better.

Errors that are smooth along the path or in time are hypotheses, weighted by their own evidence, see
`smooth_solution`; which of them are likely is found by `likelier_errors`.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.evidence.bent_slide import far_evidence
from crossmodal.systems.kinematics.evidence.covariance_floor import USUAL_DEVIATION
from crossmodal.systems.kinematics.evidence.deviation_series import (
    Waves,
    add_keyframes,
    no_waves,
    with_path_waves,
)
from crossmodal.systems.kinematics.evidence.smooth_solution import smooth_evidence
from crossmodal.systems.kinematics.evidence.wander import NONE, Wander, wander_waves
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
    JOINTS,
    PRISMATIC,
    REVOLUTE,
    SCREW,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import new_linear
from crossmodal.systems.kinematics.solver.joint_models import Models, copy_models
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.joint_start import copy_model
from crossmodal.systems.kinematics.solver.parameter_priors import hinge_evidence, may_be_far


def bend(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, rough: Array, errors: Waves
) -> float:
    """See `far_evidence`; the arguments are those of `smooth_evidence`."""
    waves = errors
    if np.trace(deviations) > 0.0:
        waves = with_path_waves(m.q[PRISMATIC], int(kf.size[0]), deviations, errors)
    lin = new_linear(kf.time.size, int(waves.variance.size))
    add_keyframes(BENT_SLIDE, m, kf, rough, waves, lin)
    return far_evidence(m, kf, priors, waves, lin)


# Share of the usual deviations' variance that a joint has for certain if rotations err: by these
# alone, a bent path would seem to be a perfect one about another axis.
_WITH_ERRORS = 0.1
_ROUGH = 0.25  # Independent deviations beside the smooth ones, as a share of these.
_UNUSUAL = 5.0  # Prior log odds against smooth deviations, [nat].
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
    rough: Array,
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
        far = slide + bend(m, kf, priors, deviations, rough, errors)
        evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
        evidence[SCREW] = max(evidence[SCREW], far)


def _evidence_with(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, rough: Array, errors: Waves
) -> tuple[Array, Models]:
    """`type_evidence` if the errors are these for certain; see `smooth_evidence`."""
    if errors.variance.size > 0:  # They turn a slide as a far hinge does.
        priors = priors._replace(far_axes=False)
    evidence, at = m.log_evidence.copy(), copy_models(m)
    if np.trace(deviations) == 0.0 and errors.variance.size == 0 and kf.wander[0] == 0.0:
        pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    else:
        pitch, variance = smooth_evidence(m, kf, priors, deviations, rough, errors, evidence, at)
    _count_limits(evidence, pitch, variance, m, kf, priors, deviations, rough, errors)
    return evidence, at


NO_GAIN = np.full((2, JOINTS), -np.inf)  # Of a wander that nobody has looked for.


def type_evidence(
    m: Models,
    kf: Keyframes,
    priors: Priors,
    deviations: Array,
    wander: Wander = NONE,
    gain: Array = NO_GAIN,
    log_odds: float = 0.0,
) -> tuple[Array, Models]:
    """Log evidence (5,) of each type, and the models as they are with the likeliest errors.

    Errors are independent, or smooth along the path, or smooth in time, weighted by the evidence.
    Smooth deviations from a path are less common, the more so the larger they are than the usual
    deviations of joints.

    Args:
        deviations: Covariance (6, 6), in B, of smooth deviations from the path; zero for none.
        wander: The likeliest but none.
        gain: (2, J) log evidence of each joint with whichever wander over that of all, and of
            itself, with this one, or without any for models that are solved without; as it was
            when others were last tried.
        log_odds: Prior log odds of it against none, [nat].
    """
    evidence, at = with_deviations(m, kf, priors, deviations, no_waves(kf.time.size))
    if wander == NONE:
        return evidence, at
    solved, other = evidence.copy(), at
    if kf.wander[0] > 0.0:
        solved, other = with_deviations(m, kf, priors, deviations, wander_waves(wander, kf))
    of_joints, log_odds = solved[:JOINTS], log_odds + wander.log_prior
    # A model that is far behind has not been solved since, and neither is reliable alone.
    solved[:JOINTS] = np.minimum(np.logaddexp.reduce(of_joints) + gain[0], of_joints + gain[1])
    if kf.wander[0] == 0.0:
        evidence[:JOINTS] = np.logaddexp(evidence[:JOINTS], solved[:JOINTS] + log_odds)
        return evidence, at
    return _mixed(evidence, at, solved + log_odds, other)


def _mixed(
    evidence: Array, at: Models, other_evidence: Array, other: Models
) -> tuple[Array, Models]:
    """Evidence of a mixture of two hypotheses, and its models, in `at`; see `type_evidence`.

    Each is that of its likelier hypothesis, with the mean covariance.
    """
    total = np.logaddexp(evidence, other_evidence)
    for kind in range(JOINTS):
        p = np.exp(other_evidence[kind] - total[kind])
        covariance = p * other.covariance[kind] + (1.0 - p) * at.covariance[kind]
        if p > 0.5:
            copy_model(kind, other, kind, at)
        at.covariance[kind] = covariance
    return total, at


def with_deviations(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array, errors: Waves
) -> tuple[Array, Models]:
    """`type_evidence` with these errors, and deviations from the path that there may be."""
    least = np.diag(_WITH_ERRORS * USUAL_DEVIATION) if errors.variance.size else 0.0 * deviations
    evidence, at = _evidence_with(m, kf, priors, least, kf.floor, errors)
    if np.trace(deviations) == 0.0:
        return evidence, at
    unusual = _UNUSUAL + 0.5 * deviations[3, 3] / USUAL_DEVIATION[3]
    deviations, rough = np.maximum(deviations, least), _ROUGH**2 * deviations
    smooth, other = _evidence_with(m, kf, priors, deviations, rough, errors)
    return _mixed(evidence, at, smooth - unusual, other)
