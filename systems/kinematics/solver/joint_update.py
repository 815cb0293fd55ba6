"""One update of the joint models with one relative pose, all in place."""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.se3_in_place import relative_log
from crossmodal.systems.kinematics.keyframes import pose_keyframes
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    MEMORY,
    Keyframes,
    measured_directions,
)
from crossmodal.systems.kinematics.solver.free_motion import explain, explain_pending, free_evidence
from crossmodal.systems.kinematics.solver.joint_geometry import (
    FREE,
    JOINTS,
    MOVING,
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    SCREW,
    screw_twists,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    add_keyframes,
    clear,
    embedding,
    new_linear,
    prior_offset,
)
from crossmodal.systems.kinematics.solver.joint_models import Models, has_prior
from crossmodal.systems.kinematics.solver.joint_solver import (
    Priors,
    solve_moving,
    solve_rigid,
)
from crossmodal.systems.kinematics.solver.joint_start import (
    circle_start,
    copy_model,
    decide_signs,
    fresh_start,
    reverse_axis,
    start_from_revolute,
)

_STREAK = 3  # A longer streak of outliers may be a free motion.
STEPS = 6  # Most linearisations of one update.
_FRESH_STEPS = 8  # Most linearisations from a fresh start.
_TEMPERED_STEPS = 3  # Most linearisations before these, with residuals that count less.
_TEMPER = 10.0  # Factor by which they count less: a start far off must not make outliers.
# Log evidence below the best model's from which a model is not solved at every update, [nat].
_PRUNING_THRESHOLD = 30.0
_SURPRISE = 5.0  # Loss of the best model's log evidence from which all models are solved, [nat].


def _delete_configuration(m: Models, kf: Keyframes, k: int) -> None:
    n = kf.size[0]
    m.q[:, k:n] = m.q[:, k + 1 : n + 1]
    m.inlier[:, k:n] = m.inlier[:, k + 1 : n + 1]


@hot
def _step_loss(m: Models, kf: Keyframes, k: int) -> float:
    """Chi-square of the step from keyframe k to the next off the likeliest joint's path.

    No more than noise would lose: a correlated error is the same in both.
    """
    six, kind = int(np.int64(6)), int(np.argmax(m.log_evidence[:JOINTS]))
    G, step = np.zeros((6, 6)), np.empty(6)
    if kind != RIGID:
        screw_twists(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], G)
    L, along = kf.R[k] + kf.R[k + 1] + 2.0 * kf.floor, G[0]
    relative_log(kf.Z[k], kf.Z[k + 1], step)
    cholesky.factor(L, six)
    cholesky.forward(L, step, six)
    cholesky.forward(L, along, six)
    square, product, length, expected = 0.0, 0.0, 0.0, float(measured_directions(kf, k))
    for i in range(6):
        square += step[i] * step[i]
        product += step[i] * along[i]
        length += along[i] * along[i]
    if kind != RIGID:
        square -= product * product / length
        expected -= 1.0
    return min(square, expected)


@hot
def expected_inliers(m: Models, kf: Keyframes, log_prior: Array, inlier: Array) -> None:
    """Writes the probability that each keyframe is an inlier, by all models, into `inlier` (K,).

    Streaks of undecided keyframes are brought up to date. A model whose path the motion has left
    takes every measurement for an outlier. In a long streak those that a free motion explains count
    as inliers.
    """
    p = np.exp(m.log_evidence + log_prior - (m.log_evidence + log_prior).max())
    p /= p.sum()
    for k in range(kf.size[0]):
        inlier[k] = 1.0
        if kf.undecided[k] == 0.0:
            continue
        inlier[k] = 0.0
        for kind in range(JOINTS + 1):
            inlier[k] += p[kind] * m.inlier[kind, k]
        before = kf.streak[k - 1] if k > 0 else 0.0
        kf.streak[k] = before + 1.0 if inlier[k] < 0.5 else 0.0
        if kf.streak[k] > _STREAK:
            inlier[k] = max(inlier[k], m.inlier[FREE, k])


@hot
def _shows_pitch(log_evidence: Array, kf: Keyframes) -> bool:
    """Whether rotations are measured, to within a radian, or no hinge explains the positions.

    By positions alone a helix of less than a turn and a tilted circle differ by less than a real
    hinge deviates, so that the pitch is not estimated while a hinge explains them.
    """
    R = kf.R[kf.size[0] - 1]
    is_seen = min(R[0, 0], R[1, 1], R[2, 2]) < 1.0
    return bool(is_seen or log_evidence[REVOLUTE] < log_evidence[FREE] - _SURPRISE)


def solve_all(m: Models, kf: Keyframes, priors: Priors, steps: int, all_models: bool) -> bool:
    """Solves the models that are scheduled, linearised at most `steps` times each.

    Args:
        all_models: Whether all models are scheduled. Otherwise those whose evidence is too far
            below the best model's are skipped, and so is the screw while the revolute model, which
            is its limit of no pitch, explains more. Skipped models inherit the best model's change
            in log evidence. A measurement that surprises the best model schedules all.

    Returns:
        Whether all models were scheduled.
    """
    before, solved = m.log_evidence.copy(), np.zeros(JOINTS + 1, dtype=np.bool_)
    # A free motion has no need of a tracker's errors, with which the joints are solved.
    best = int(np.argmax(before[:JOINTS] if kf.wander[0] > 0.0 else before))
    seen, gain = _shows_pitch(before, kf), 0.0
    ratio = before[SCREW] - before[REVOLUTE] if seen else 0.0
    for i in range(-1, JOINTS + 1):
        kind = best if i < 0 else i  # The best model first, since others inherit its change.
        is_scheduled = all_models or before[kind] > before[best] - _PRUNING_THRESHOLD
        if kind == SCREW:
            is_scheduled = ratio > 0.0 or (seen and all_models)
        if solved[kind] or not is_scheduled:
            continue
        if kind == SCREW and ratio < 0.0:
            start_from_revolute(m, kf)
        if kind == RIGID:
            solve_rigid(m, kf, priors)
        elif kind == FREE:
            free = free_evidence(kf, priors.free, priors.outliers, m.inlier[FREE])
            m.log_evidence[FREE] = free + m.marginal_evidence[FREE]
        else:
            solve_moving(kind, m, kf, priors, steps, 1.0)
        solved[kind] = True
        if kind == best:
            gain = m.log_evidence[best] - before[best]
            all_models = all_models or gain < -_SURPRISE
    for kind in range(JOINTS + 1):
        if not solved[kind]:
            m.log_evidence[kind] = before[kind] + gain
            if kind < RIGID:
                m.state[kind, 0] = m.q[kind, kf.size[0] - 1]
    if not solved[SCREW]:
        m.log_evidence[SCREW] = m.log_evidence[REVOLUTE] + ratio
        m.inlier[SCREW] = m.inlier[REVOLUTE]
    return all_models


def marginalise(m: Models, kf: Keyframes, k: int, priors: Priors) -> None:
    """Removes keyframe k; its information goes into a Gaussian prior of theta and the evidence.

    Its configuration is marginalised with a flat prior, so that the information of the motion
    before and after it is lost.
    """
    log_evidence = m.log_evidence.copy()
    explain_pending(kf, priors.free, priors.outliers, m.inlier[FREE])
    size = PARAMETERS + 2
    d, T, lin = np.empty(size), np.empty((PARAMETERS, size)), new_linear(kf.time.size)
    for kind in range(JOINTS):
        m.signed[kind] = 1.0
        prior_offset(kind, m, d)
        gradient = m.prior_vector[kind] - m.prior_information[kind] @ d
        m.prior_value[kind] += 0.5 * (d @ (m.prior_vector[kind] + gradient))
        m.prior_Y[kind], m.prior_a[kind], m.prior_c[kind] = m.Y[kind], m.a[kind], m.c[kind]
        m.prior_pitch[kind] = m.pitch[kind]
        clear(lin)
        add_keyframes(kind, m, kf, k, k + 1, priors.outliers[0], 1.0, lin)
        lower = np.tril(lin.information, -1)
        information = lower + lower.T + np.diag(np.diagonal(lin.information))
        embedding(m.a[kind], T)
        m.prior_information[kind] += T.T @ information @ T
        m.prior_vector[kind] = gradient + T.T @ lin.vector
        m.prior_value[kind] += lin.value[0]
    pose_keyframes.remove(kf, k)
    _delete_configuration(m, kf, k)
    solve_all(m, kf, priors, 2, True)
    solved = m.log_evidence - m.marginal_evidence
    evidence = log_evidence - solved
    m.marginal_evidence[:] = np.maximum(evidence - evidence.max(), -MEMORY)
    m.log_evidence[:] = solved + m.marginal_evidence


def _solve_from_afar(kind: int, m: Models, kf: Keyframes, priors: Priors) -> None:
    solve_moving(kind, m, kf, priors, _TEMPERED_STEPS, _TEMPER)
    solve_moving(kind, m, kf, priors, _FRESH_STEPS, 1.0)


def restart(m: Models, kf: Keyframes, priors: Priors, all_models: bool) -> None:
    """Takes over the models that explain more from a fresh start; see `solve_all`."""
    other = Models(*[x.copy() for x in m])
    fresh_start(other, kf, priors.axis_distance, priors.outliers[0])
    ratio = m.log_evidence[SCREW] - m.log_evidence[REVOLUTE]
    screw = all_models and _shows_pitch(m.log_evidence, kf)
    moving = MOVING if screw else (PRISMATIC, REVOLUTE)
    for kind in moving:
        _solve_from_afar(kind, other, kf, priors)
    solve_rigid(other, kf, priors)
    _take_over(m, other, (*moving, RIGID))
    if kf.size[0] > 3 and m.log_evidence[REVOLUTE] < m.log_evidence.max():
        circle_start(other, kf, priors.axis_distance)
        _solve_from_afar(REVOLUTE, other, kf, priors)
        _take_over(m, other, (REVOLUTE,))
    if not screw and ratio <= 0.0:  # Its limit, from which it starts, is likelier now.
        m.log_evidence[SCREW] = m.log_evidence[REVOLUTE] + ratio


def _take_over(m: Models, other: Models, kinds: tuple[int, ...]) -> None:
    """Copies the models of `other` that explain more."""
    for kind in kinds:
        if other.log_evidence[kind] > m.log_evidence[kind] + 0.1:
            turned = other.state[kind, 0] * m.state[kind, 0] < 0.0
            if kind != RIGID and turned and not has_prior(kind, m):
                reverse_axis(kind, other)
            copy_model(kind, other, kind, m)


def add_measurement(
    m: Models, kf: Keyframes, X_FB: Array, R: Array, time: float, priors: Priors, log_prior: Array
) -> None:
    """Appends one pose; where there is no room, two keyframes are averaged or one is marginalised.

    The arguments are those of `update`.
    """
    inlier, average = np.empty(kf.time.size), False
    expected_inliers(m, kf, log_prior, inlier)
    if kf.size[0] == kf.time.size:
        k, average = pose_keyframes.choose(kf, priors.coarseness, inlier)
        if average and np.isnan(kf.explained[0]):
            explain(kf, priors.free, priors.outliers, m.inlier[FREE])
        pose_keyframes.fix(kf, k, inlier[k])
        if average:
            pose_keyframes.fix(kf, k + 1, inlier[k + 1])
            kf.explained[:] += 0.5 * _step_loss(m, kf, k)
            kind = int(np.argmax(m.log_evidence[:JOINTS]))
            angle = m.q[kind, k + 1] - m.q[kind, k] if turns(kind) else 0.0
            pose_keyframes.merge(kf, k, angle * m.a[kind])
            _delete_configuration(m, kf, k + 1)
        else:
            marginalise(m, kf, k, priors)
            expected_inliers(m, kf, log_prior, inlier)
    if not average:
        kf.explained[:] = np.nan
    pose_keyframes.append(kf, X_FB, R, time, priors.outliers)
    last, dt = kf.size[0] - 1, time - kf.time[kf.size[0] - 2]
    m.inlier[:, last] = 1.0
    for kind in MOVING:
        m.q[kind, last] = m.state[kind, 0] + dt * m.state[kind, 1]


def update(
    m: Models,
    kf: Keyframes,
    X_FB: Array,
    R: Array,
    time: float,
    priors: Priors,
    log_prior: Array,
    try_fresh_start: bool,
    all_models: bool,
) -> None:
    """Corrects all models with one relative pose.

    Args:
        kf: Keyframes, the reference at least.
        X_FB: Pose (4, 4) relative to the measured reference.
        R: Its covariance (6, 6), in B.
        time: [s].
        log_prior: (5,) log probability of each type before anything was measured.
        try_fresh_start: Whether to try one beside the last solution.
    """
    add_measurement(m, kf, X_FB, R, time, priors, log_prior)
    all_solved = solve_all(m, kf, priors, STEPS, all_models)
    decide_signs(m)
    if try_fresh_start and all_solved:
        restart(m, kf, priors, all_models)
        decide_signs(m)
