"""The evidence of the joint types, from what the models say near each other's limits.

A slide is the limit of hinges far away, a hinge the limit of screws without pitch. What a model's
own solution says is Laplace's approximation about it; near a limit the other model's is better.
Where strays from the path are smooth (`smooth_strays`), that counts for all types alike.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_solver.axis_prior import may_be_far
from crossmodal.systems.kinematics.joint_solver.joint_geometry import (
    JOINTS,
    PRISMATIC,
    REVOLUTE,
    SCREW,
)
from crossmodal.systems.kinematics.joint_solver.joint_models import Models
from crossmodal.systems.kinematics.joint_solver.joint_pitch import hinge_evidence
from crossmodal.systems.kinematics.joint_solver.joint_solver import Priors
from crossmodal.systems.kinematics.joint_solver.path_floor import FLOORS, STRAY, floor, whose_turn
from crossmodal.systems.kinematics.joint_solver.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.joint_solver.smooth_strays import bend, smooth_evidence

_UNUSUAL = 5.0  # Log odds against smooth strays at all, [nat].
# How many of `FLOORS` smooth strays may have; with the largest a ball would be a hinge that bends.
_SIZES = len(FLOORS) - 1
_WORTH = 0.5  # Gain in log probability from which other strays are taken, [nat].
_AHEAD = 3.0  # Log evidence over the slide's from which a hinge's own solution counts, [nat].
_FAR_BEHIND = 20.0  # Log evidence below the most from which a slide's makes no difference, [nat].


def _add_hinges(evidence: Array, pitch: float, variance: float, priors: Priors) -> None:
    """Counts a screw of next to no pitch as a hinge, in place."""
    hinge = evidence[SCREW] + hinge_evidence(pitch, variance, priors.hinge_pitch)
    evidence[REVOLUTE] = max(evidence[REVOLUTE], hinge)


def _wants_bend(evidence: Array, kf: Keyframes, priors: Priors) -> bool:
    """Whether a hinge far away may be likelier than one whose axis' place is known."""
    slide = evidence[PRISMATIC]
    matters = evidence.max() - _FAR_BEHIND < slide and evidence[REVOLUTE] < slide + _AHEAD
    return bool(matters and priors.far_axes and may_be_far(kf))


def _add_bend(evidence: Array, bend: float) -> None:
    """Counts a bent slide as a hinge far away, where a pitch makes no difference; in place."""
    far = evidence[PRISMATIC] + bend
    evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
    evidence[SCREW] = max(evidence[SCREW], far)


def type_evidence(m: Models, kf: Keyframes, priors: Priors, strays: Array) -> tuple[Array, Array]:
    """Log evidence (5,) of each type, and covariance (J, N, N) of each model's theta.

    Whether strays are independent or smooth, each as likely as the keyframes say.

    Smooth ones are unusual, the more so the larger they are than joints' usual strays.

    Args:
        m: Models, solved.
        kf: Keyframes.
        priors: See `Priors`.
        strays: Covariance (6, 6), in B, of smooth strays; zero for none.
    """
    evidence = m.log_evidence.copy()
    _add_hinges(evidence, m.pitch[SCREW], m.covariance[SCREW, 10, 10], priors)
    if _wants_bend(evidence, kf, priors):
        _add_bend(evidence, bend(m, kf, priors, 0.0 * strays))
    if np.trace(strays) == 0.0:
        return evidence, m.covariance.copy()
    unusual = _UNUSUAL + 0.5 * strays[3, 3] / STRAY[3]
    smooth, covariance = np.empty(evidence.size), np.empty(m.covariance.shape)
    pitch, variance = smooth_evidence(m, kf, priors, strays, smooth, covariance)
    for kind in range(JOINTS):
        p = 1.0 / (1.0 + np.exp(min(m.log_evidence[kind] - smooth[kind] + unusual, 50.0)))
        covariance[kind] = p * covariance[kind] + (1.0 - p) * m.covariance[kind]
    _add_hinges(smooth, pitch, variance, priors)
    if _wants_bend(smooth, kf, priors):
        _add_bend(smooth, bend(m, kf, priors, strays))
    return np.logaddexp(evidence, smooth - unusual), covariance


def _total(log_p: Array) -> float:
    return log_p.max() + np.log(np.exp(log_p - log_p.max()).sum())


def likelier_strays(
    m: Models,
    kf: Keyframes,
    index: int,
    tries: int,
    claimed: Array,
    scale: Array,
    priors: Priors,
    log_prior: Array,
) -> int:
    """Index in `FLOORS` of how large smooth strays are: the same, or the one whose turn it is.

    That under which all keyframes are likelier, whatever the type. The arguments are those of
    `with_likelier_floor`.
    """
    other = whose_turn(index, tries, _SIZES)
    now, then = (
        _total(type_evidence(m, kf, priors, floor(i, claimed, scale))[0] + log_prior)
        for i in (index, other)
    )
    return other if then - now > _WORTH else index
