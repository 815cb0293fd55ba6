"""Which features belong to which rigid body, by how they moved."""

from dataclasses import replace

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.rigid_points import pose_jacobian
from crossmodal.systems.port_values import STATIC_BODY
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies import body_filter, held_body
from crossmodal.systems.vision.bodies.body_tracker_state import TrackedBody
from crossmodal.systems.vision.bodies.body_tracking import corrected
from crossmodal.systems.vision.bodies.feature_displacements import displacements, squared_distances
from crossmodal.systems.vision.bodies.feature_history import OUTLIER, FeatureHistory, forget
from crossmodal.systems.vision.bodies.rigid_body_motion_config import GATE, RigidBodyMotionConfig


def body_against_static(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory
) -> tuple[Array, Array]:
    """Log likelihood ratios (N,) of moving with the body over standing still, and fits (N,).

    Both hypotheses explain the displacement from the earlier mean position to the newest, with the
    covariance of both means and, for the body, of its pose; zero where there is too little to tell.
    The fit is the squared Mahalanobis distance under the body.
    """
    use_rest = history.rest_until <= body.reference_tick
    newest = whole_ticks(config.history.newest, config.period)
    moving = displacements(
        history,
        newest=newest,
        X_WB=body.path,
        use_rest=use_rest,
        X_WB_rest=body.X_WB_reference,
    )
    standing = displacements(history, newest=newest, use_rest=use_rest)
    enough = history.seen & (moving.count_new >= 2) & (moving.count_old >= 4)
    ratio, fit = np.zeros(len(enough)), np.full(len(enough), np.inf)
    if not enough.any():
        return ratio, fit
    floor = config.history.floor**2 * np.eye(3)
    J = pose_jacobian(moving.p_new[enough])
    pose = J @ body.filter.P[:6, :6] @ J.transpose(0, 2, 1)
    S = (moving.C_old + moving.C_new)[enough] + pose + floor
    chi, log_determinant = squared_distances((moving.p_new - moving.p_old)[enough], S)
    S = (standing.C_old + standing.C_new)[enough] + floor
    chi_static, log_static = squared_distances((standing.p_new - standing.p_old)[enough], S)
    ratio[enough] = 0.5 * (chi_static + log_static - chi - log_determinant)
    fit[enough] = chi
    return ratio, fit


def _distances(history: FeatureHistory, body_id: int) -> Array:
    """Each feature's distance (N,) to the nearest feature of a body, [m]; zero if it has none."""
    members = history.p_W[history.body == body_id, -1]
    if len(members) == 0:
        return np.zeros(len(history.ids))
    difference = history.p_W[:, None, -1] - members
    return np.asarray(np.sqrt(np.min(np.sum(difference**2, axis=2), axis=1)))


def associate(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> FeatureHistory:
    """Assigns features to bodies whose motion explains theirs and releases the others.

    A body is compact: a feature far from those that it has needs more evidence to join.
    """
    if not bodies or len(history.ids) == 0:
        return history
    tests = [body_against_static(config, body, history) for body in bodies]
    ids = np.array([body.body_id for body in bodies])
    ratios = np.array([np.where(fit < GATE, ratio, -np.inf) for ratio, fit in tests])
    distances = np.array([_distances(history, body.body_id) for body in bodies])
    ratios -= np.minimum(
        0.5 * (distances / config.association.extent) ** 2, config.association.max_penalty
    )
    ratios = held_body.without_refused(config, bodies, history, ratios)
    best = np.argmax(ratios, axis=0)
    highest = ratios[best, np.arange(len(history.ids))]
    assigned = history.body.copy()
    blind = np.array([held_body.is_blind(config, body) for body in bodies])
    joins = (history.body == STATIC_BODY) & (highest > config.association.log_ratio) & ~blind[best]
    for i, body_id in enumerate(ids):
        first = joins & (best == i)
        # A body that has no feature yet gets several at once, or an outlier would steer it.
        if not np.any(history.body == body_id) and np.sum(first) < config.keep_support:
            joins &= ~first
    assigned[joins] = ids[best[joins]]
    for i, (ratio, _) in enumerate(tests):
        mine = history.body == ids[i]
        assigned[mine & (ratio < -config.association.log_ratio)] = STATIC_BODY
        # Another moving body explains it better than its own.
        moves = mine & (highest > np.maximum(ratio, 0.0) + config.association.log_ratio)
        moves &= ~blind[best]
        assigned[moves] = ids[best[moves]]
    changed = assigned != history.body
    return replace(
        history, body=assigned, rejection_count=np.where(changed, 0, history.rejection_count)
    )


def merged(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> tuple[list[TrackedBody], FeatureHistory]:
    """Gives a body's features to an older one that explains the motion of nearly all of them."""
    assigned, rejection_count = history.body.copy(), history.rejection_count.copy()
    kept: list[TrackedBody] = []
    for body in bodies:
        mine = assigned == body.body_id
        absorbed = False
        for older in kept:
            if not held_body.may_absorb(config, older, body):
                continue
            ratio, fit = body_against_static(config, older, history)
            known = mine & (np.abs(ratio) > config.association.log_ratio)
            if np.sum(known) < config.keep_support:
                continue
            shared = known & (ratio > config.association.log_ratio) & (fit < GATE)
            rows = np.nonzero(shared)[0]
            if not held_body.accepts(config, older, history, rows):
                continue
            if np.sum(shared) >= config.association.merging_share * np.sum(known):
                assigned[mine], rejection_count[mine] = older.body_id, 0
                absorbed = True
                break
        if not absorbed:
            kept.append(body)
    return kept, replace(history, body=assigned, rejection_count=rejection_count)


def without_outliers(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> list[TrackedBody]:
    """Removes the landmarks of features that do not belong to the body, and what they did to it."""
    kept = []
    for body in bodies:
        others = history.ids[history.body != body.body_id]
        outliers = body.filter.ids[np.isin(body.filter.ids, others)]
        if len(outliers):
            sigma = config.dynamics.jump
            filtered = body_filter.reset_to_initial(
                body_filter.remove_landmarks(body.filter, outliers), sigma
            )
            body = replace(body, filter=corrected(config, filtered, history))
        kept.append(body)
    return kept


def reject_outliers(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> FeatureHistory:
    """Takes features from bodies that they disagreed with or slid on; those are ignored."""
    slid = np.zeros(len(history.ids), bool)
    for body in bodies:
        drifted = body.filter.ids[body_filter.drifted(body.filter, GATE)]
        slid |= (history.body == body.body_id) & np.isin(history.ids, drifted)
    outlier = history.body == OUTLIER
    most = whole_ticks(config.association.rejection_time, config.period)
    rejected = ~outlier & (history.body != STATIC_BODY) & (history.rejection_count >= most)
    rejection_count = np.where(outlier, history.rejection_count + 1, history.rejection_count)
    return replace(
        history,
        body=np.where(rejected | slid, OUTLIER, history.body),
        rejection_count=np.where(rejected | slid, 0, rejection_count),
    )


def reset_tracks(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> FeatureHistory:
    """Frees features whose body ended, or that were rejected for long.

    All their samples but the newest are forgotten.
    """
    numbers = [STATIC_BODY, OUTLIER, *(body.body_id for body in bodies)]
    unbound = (history.body == STATIC_BODY) | (history.body == OUTLIER)
    most = whole_ticks(config.association.free_rejection_time, config.period)
    rows = unbound & (history.rejection_count >= most)
    rows |= ~np.isin(history.body, numbers)
    if not rows.any():
        return history
    return forget(history, np.nonzero(rows)[0], 1)
