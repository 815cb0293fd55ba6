"""How much the child deviates from an ideal joint's path, from the evidence of all models.

Errors that depend on the place, as those of a camera's calibration, and a path that is not quite
straight or round do not average out within a keyframe. Their covariance is the keyframes'
covariance floor. The errors are no larger than a measurement's noise, and than the reported one;
the path's deviation is independent of both, a few times the usual deviation of joints. Of several
multiples of both, the one under which all keyframes are likeliest is kept, whatever the type.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.keyframes import pose_keyframes
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import FREE
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.joint_update import STEPS, restart, solve_all

# Multiples of standard deviations, see `covariance_floor`.
FLOORS = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
# Variance [rad^2, m^2] of a joint's usual deviation: doors, drawers and lids have play.
USUAL_DEVIATION = np.repeat([5e-3**2, 1.5e-3**2], 3)
_LEAST_GAIN = 0.5  # Least gain in log probability by another floor, [nat].


def covariance_floor(index: int, reported: Array, scale: Array) -> Array:
    """The floor (6, 6) of a multiple.

    Args:
        index: Of `FLOORS`.
        reported: Covariance (6, 6) of a measurement.
        scale: (6,) its noise's estimated standard deviations by the reported ones.
    """
    larger = np.maximum(scale, 1.0)
    floor = min(FLOORS[index], 1.0) ** 2 * (reported * np.outer(larger, larger))
    variances = np.maximum(np.diagonal(floor), FLOORS[index] ** 2 * USUAL_DEVIATION)
    np.fill_diagonal(floor, variances)
    return np.asarray(floor)


def next_index(index: int, tries: int, count: int) -> int:
    """Another index below `count` than `index`; all of them follow one another over the tries."""
    return (index + 1 + tries % (count - 1)) % count


def log_probability(m: Models, kf: Keyframes, log_prior: Array) -> float:
    """Of all keyframes under their floor, whatever the type."""
    of_all = np.logaddexp.reduce(m.log_evidence + log_prior)
    return float(of_all - 0.5 * kf.log_det[: kf.size[0]].sum())


def with_likelier_floor(
    m: Models,
    kf: Keyframes,
    index: int,
    tries: int,
    reported: Array,
    scale: Array,
    priors: Priors,
    log_prior: Array,
) -> tuple[Models, Keyframes, int]:
    """The same, or those with the floor that is tried next, if it makes everything likelier.

    All keyframes must have been explained by free motions, see `explain_pending`.

    Args:
        m: Models; not changed.
        kf: Keyframes; not changed.
        index: In `FLOORS`, of the floor that they have.
        tries: How many there were, by which the next one is chosen.
        log_prior: (5,) log probability of each type before anything was measured.
    """
    other = next_index(index, tries, len(FLOORS))
    models, frames = Models(*[x.copy() for x in m]), pose_keyframes.copy_keyframes(kf)
    floor = covariance_floor(other, reported, scale)
    pose_keyframes.rescale(frames, np.ones(6), floor, priors.outliers)
    solve_all(models, frames, priors, STEPS, True)
    if models.log_evidence[FREE] > models.log_evidence[:FREE].max():
        restart(models, frames, priors, True)
    gain = log_probability(models, frames, log_prior) - log_probability(m, kf, log_prior)
    return (models, frames, other) if gain > _LEAST_GAIN else (m, kf, index)
