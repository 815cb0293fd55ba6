"""Which smooth errors are likeliest: the path's deviations, and those of a tracker's rotations."""

from collections.abc import Callable
from operator import itemgetter

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.evidence.covariance_floor import (
    FLOORS,
    covariance_floor,
    next_index,
)
from crossmodal.systems.kinematics.evidence.type_evidence import with_deviations
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
)
from crossmodal.systems.kinematics.solver.joint_geometry import JOINTS, MOVING
from crossmodal.systems.kinematics.solver.joint_models import Models, copy_models
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.joint_update import STEPS, restart, solve_all

# Of `FLOORS`; with the largest a ball joint would be a hinge with smooth deviations.
_DEVIATIONS = len(FLOORS) - 1
_LEAST_GAIN = 0.5  # Least gain in log probability by other errors, [nat].


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
    other = next_index(index, tries, _DEVIATIONS)
    floors = [covariance_floor(i, reported, scale) for i in (index, other)]
    errors = wander_waves(wander if kf.wander[0] > 0.0 else NONE, kf)
    evidence = [with_deviations(m, kf, priors, floor, errors)[0] for floor in floors]
    now, then = np.logaddexp.reduce(np.array(evidence) + log_prior, axis=1)
    return other if then - now > _LEAST_GAIN else index


def likelier_wander(
    m: Models,
    kf: Keyframes,
    before: Wander,
    smallest: int,
    of_path: Array,
    tries: int,
    priors: Priors,
    log_prior: Array,
    log_odds: float,
) -> tuple[Models, Keyframes, Wander, Array]:
    """The likeliest wander, and the models and keyframes, solved with it where it is likely.

    It is that under which the joints explain most, whichever that is; another joint may explain as
    much with another one, so that all that were tried count in the evidence of each. If rotations
    err, joints found without that explain nothing, so that they are solved with a generous error
    before all are compared.

    Args:
        m: Models; not changed.
        kf: Keyframes; not changed. All must have been explained by free motions.
        before: The likeliest before; `NONE` if nobody has looked.
        smallest: Index of the smallest size that counts; those below are within what is reported.
        of_path: Covariance (6, 6) of smooth deviations from the path, the likeliest or none: what
            these explain is no error of rotations.
        tries: How many there were, by which the time is chosen that is tried beside.
        log_odds: Of a wander of the smallest size against none, before anything was measured.

    Returns:
        Models, keyframes, the likeliest wander, and its `gain`, see `type_evidence`.
    """
    none_of_path = 0.0 * of_path
    start = Wander(max(smallest, GENEROUS.at_size), GENEROUS.at_time)
    start = before if before.at_size >= smallest else start
    is_used = kf.wander[0] > 0.0
    models, frames = (m, kf) if is_used else _solved_with(start, m, kf, priors)
    values: dict[Wander, Array] = {}

    def total(of_joints: Array) -> float:
        return float(np.logaddexp.reduce(of_joints + log_prior[:JOINTS]))

    def evidence(wander: Wander, of_path: Array) -> Array:
        at, errors = (models, frames) if wander != NONE else (m, kf), wander_waves(wander, kf)
        of_joints = with_deviations(*at, priors, of_path, errors)[0][:JOINTS]
        return np.asarray(of_joints - 0.5 * at[1].log_det[: at[1].size[0]].sum())

    def value(wander: Wander) -> Array:
        if wander not in values:
            values[wander] = evidence(wander, none_of_path) + wander.log_prior
        return values[wander]

    def climb(best: Wander, of: Callable[[Array], float]) -> Wander:
        while True:
            beside = [w for w in best.neighbours if w.at_size >= smallest]
            other = max(beside, key=lambda w: of(value(w)))
            if of(value(other)) < of(value(best)) + _LEAST_GAIN:
                return best
            best = other

    best = max(
        [start, *(Wander(n, tries % len(TIMES)) for n in range(smallest, len(SIZES)))],
        key=lambda w: total(value(w)),
    )
    best = start if total(value(best)) < total(value(start)) + _LEAST_GAIN else best
    best = climb(best, total)
    for kind in MOVING:
        of_kind = itemgetter(kind)
        climb(max(values, key=lambda w: of_kind(values[w])), of_kind)
    others = np.logaddexp.reduce(list(values.values())) - values[best]
    without, with_it = evidence(NONE, of_path), evidence(best, of_path)
    log_odds += best.log_prior + total(with_it + others) - total(without)
    is_better = log_odds > (-_LEAST_GAIN if is_used else _LEAST_GAIN)
    base = with_it if is_better else without
    gain = with_it + others - np.array([np.repeat(np.logaddexp.reduce(base), JOINTS), base])
    wanted = best if is_better else NONE
    for at in ((m, kf), (models, frames)):
        if at[1].wander[0] == wanted.variance:
            return *at, best, gain
    return *_solved_with(wanted, models, kf, priors), best, gain


def _solved_with(w: Wander, m: Models, kf: Keyframes, priors: Priors) -> tuple[Models, Keyframes]:
    """Copies with another wander, solved again."""
    models, frames = copy_models(m), copy_keyframes(kf)
    rescale(frames, np.ones(6), frames.floor.copy(), priors.outliers, w.variance)
    solve_all(models, frames, priors, STEPS, True)
    restart(models, frames, priors, True)
    return models, frames
