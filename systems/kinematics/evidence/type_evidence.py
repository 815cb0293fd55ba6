"""The evidence of the joint types, from the models near each other's limits.

A slide is the limit of hinges far away, a hinge the limit of screws without pitch. The evidence of
a model's own solution is Laplace's approximation; near a limit the other model's is better. Where
deviations from the path are smooth (`smooth_deviations`), that counts for all types alike.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.evidence.covariance_floor import (
    FLOORS,
    USUAL_DEVIATION,
    covariance_floor,
    next_index,
)
from crossmodal.systems.kinematics.evidence.smooth_deviations import bend, smooth_evidence
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import (
    JOINTS,
    PRISMATIC,
    REVOLUTE,
    SCREW,
)
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.parameter_priors import hinge_evidence, may_be_far

_UNUSUAL = 5.0  # Prior log odds against smooth deviations, [nat].
# Of `FLOORS`; with the largest a ball joint would be a hinge with smooth deviations.
_SIZES = len(FLOORS) - 1
_LEAST_GAIN = 0.5  # Least gain in log probability by other deviations, [nat].
_AHEAD = 3.0  # Log evidence over the slide's from which a hinge's own solution counts, [nat].
_PRUNING_THRESHOLD = 20.0  # Log evidence of a slide below the best one's, [nat].


def _add_hinges(evidence: Array, pitch: float, variance: float, priors: Priors) -> None:
    """Counts a screw of next to no pitch as a hinge, in place."""
    hinge = evidence[SCREW] + hinge_evidence(pitch, variance, priors.hinge_pitch)
    evidence[REVOLUTE] = max(evidence[REVOLUTE], hinge)


def _wants_bend(evidence: Array, kf: Keyframes, priors: Priors) -> bool:
    """Whether a hinge far away may be likelier than one whose axis' place is known."""
    slide = evidence[PRISMATIC]
    matters = evidence.max() - _PRUNING_THRESHOLD < slide and evidence[REVOLUTE] < slide + _AHEAD
    return bool(matters and priors.far_axes and may_be_far(kf))


def _add_bend(evidence: Array, bend: float) -> None:
    """Counts a bent slide as a hinge far away, where a pitch makes no difference; in place."""
    far = evidence[PRISMATIC] + bend
    evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
    evidence[SCREW] = max(evidence[SCREW], far)


def type_evidence(
    m: Models, kf: Keyframes, priors: Priors, deviations: Array
) -> tuple[Array, Array]:
    """Log evidence (5,) of each type, and covariance (J, N, N) of each model's theta.

    Deviations are independent or smooth, weighted by the evidence. Smooth ones are less common, the
    more so the larger they are than the usual deviations of joints.

    Args:
        m: Models, solved.
        deviations: Covariance (6, 6), in B, of smooth deviations; zero for none.
    """
    evidence = m.log_evidence.copy()
    _add_hinges(evidence, m.pitch[SCREW], m.covariance[SCREW, 10, 10], priors)
    if _wants_bend(evidence, kf, priors):
        _add_bend(evidence, bend(m, kf, priors, 0.0 * deviations))
    if np.trace(deviations) == 0.0:
        return evidence, m.covariance.copy()
    unusual = _UNUSUAL + 0.5 * deviations[3, 3] / USUAL_DEVIATION[3]
    smooth, covariance = np.empty(evidence.size), np.empty(m.covariance.shape)
    pitch, variance = smooth_evidence(m, kf, priors, deviations, smooth, covariance)
    for kind in range(JOINTS):
        p = 1.0 / (1.0 + np.exp(min(m.log_evidence[kind] - smooth[kind] + unusual, 50.0)))
        covariance[kind] = p * covariance[kind] + (1.0 - p) * m.covariance[kind]
    _add_hinges(smooth, pitch, variance, priors)
    if _wants_bend(smooth, kf, priors):
        _add_bend(smooth, bend(m, kf, priors, deviations))
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
