"""The motion of known rigid bodies over one tick: predictions, correction, landmarks."""

from dataclasses import replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.rigid_points import pose_scale
from crossmodal.systems.port_values import FeatureBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies import body_filter
from crossmodal.systems.vision.bodies.body_filter import BodyFilter
from crossmodal.systems.vision.bodies.body_tracker_state import (
    BodyTrackerState,
    RestPositions,
    TrackedBody,
)
from crossmodal.systems.vision.bodies.feature_displacements import displacements, squared_distances
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory, forget, remember
from crossmodal.systems.vision.bodies.rigid_body_motion_config import GATE, RigidBodyMotionConfig


def predict(config: RigidBodyMotionConfig, body: BodyFilter) -> BodyFilter:
    """The filter one tick later, by its velocity."""
    acceleration = config.dynamics.process_noise
    return body_filter.predict(
        body, config.period, acceleration, config.landmarks.walk, config.landmarks.turn_walk
    )


def _seen_landmarks(body: BodyFilter, history: FeatureHistory) -> tuple[Ids, Ids]:
    """Indices of the landmarks whose features are seen now, and of these in the history."""
    _, landmarks, rows = np.intersect1d(body.ids, history.ids, return_indices=True)
    seen = history.seen[rows]
    return landmarks[seen], rows[seen]


def newest_samples(history: FeatureHistory, rows: Ids) -> tuple[Array, Array]:
    """Positions (K, 3) and covariances (K, 3, 3) of features that are seen now."""
    return history.p_W[rows, -1], np.linalg.inv(history.information[rows, -1])


def robust_likelihood(
    config: RigidBodyMotionConfig, body: BodyFilter, landmarks: Ids, p_WF: Array, covariance: Array
) -> float:
    """Log likelihood, up to a constant, of features at a pose; outliers count as if on the gate."""
    z, R_B = body_filter.in_body(body.X, p_WF, covariance)
    S = body_filter.innovation_blocks(body, landmarks, R_B)
    distance, log_determinant = squared_distances(z - body.p_BF[landmarks], S)
    return -0.5 * float(np.sum(np.minimum(distance, GATE) + log_determinant))


def advance(
    config: RigidBodyMotionConfig,
    body: TrackedBody,
    history: FeatureHistory,
    predictions: list[tuple[str, Array]],
) -> tuple[TrackedBody, Ids, Ids]:
    """One tick of a body: the likeliest prediction, corrected with its features.

    Args:
        config: Its parameters.
        body: At the last tick.
        history: Features up to this tick.
        predictions: What others predict for its pose now, (source, X_WB (4, 4)).

    Returns:
        The body, and the rows of the history that agreed and disagreed.
    """
    old = body_filter.remove_landmarks(body.filter, np.setdiff1d(body.filter.ids, history.ids))
    predicted = predict(config, old)
    candidates = [("velocity", predicted), ("still", replace(predicted, X=old.X, V=np.zeros(6)))]
    for source, X_WB in predictions:
        V = se3.log(se3.inverse(old.X) @ X_WB) / config.period
        candidates.append((source, replace(predicted, X=X_WB, V=V)))
    landmarks, rows = _seen_landmarks(predicted, history)
    if len(rows) == 0:
        return _coasted(config, body, old, candidates), rows, rows
    p_WF, covariance = newest_samples(history, rows)
    scores = [robust_likelihood(config, c, landmarks, p_WF, covariance) for _, c in candidates]
    source, chosen = candidates[int(np.argmax(scores))]
    chosen, fits = _agreeing(config, chosen, landmarks, p_WF, covariance)
    if body.unsupported > 0 and np.sum(fits) < config.keep_support:
        # While the pose is uncertain, any one feature would fit.
        return _coasted(config, body, old, candidates), rows[:0], rows
    filtered = body_filter.correct(chosen, landmarks[fits], p_WF[fits], covariance[fits])
    moved = recorded(config, body, filtered, source, int(np.sum(fits)))
    return moved, rows[fits], rows[~fits]


def _agreeing(
    config: RigidBodyMotionConfig,
    body: BodyFilter,
    landmarks: Ids,
    p_WF: Array,
    covariance: Array,
) -> tuple[BodyFilter, Mask]:
    """The filter, and which features (K,) agree with it.

    Where most do not, the body may have jumped: its pose is made uncertain if most agree then.
    """
    fits = body_filter.agreeing(body, landmarks, p_WF, covariance, GATE)
    if len(fits) < config.initiation.min_support or np.mean(fits) > 0.5:
        return body, fits
    sigma = config.dynamics.jump
    jumped = body_filter.inflated(body, sigma)
    again = body_filter.agreeing(jumped, landmarks, p_WF, covariance, GATE)
    return (jumped, again) if np.mean(again) > 0.6 else (body, fits)


def recorded(
    config: RigidBodyMotionConfig,
    body: TrackedBody,
    filtered: BodyFilter,
    source: str,
    support: int,
) -> TrackedBody:
    """The body with a new posterior and what supported it."""
    supported = support >= config.keep_support
    return replace(
        body,
        filter=filtered,
        path=np.concatenate([body.path[1:], filtered.X[None]]),
        support=support,
        supported=body.supported + int(supported),
        unsupported=0 if supported else body.unsupported + 1,
        source=source,
    )


def _coasted(
    config: RigidBodyMotionConfig,
    body: TrackedBody,
    old: BodyFilter,
    candidates: list[tuple[str, BodyFilter]],
) -> TrackedBody:
    """The body without features: it follows the prior where there is one, else its velocity."""
    for source, candidate in candidates:
        if source == "prior":
            walk = pose_scale(config.held_body.prior_walk)
            moved = body_filter.moved_to(old, candidate.X, config.period, walk)
            return recorded(config, body, moved, source, 0)
    return recorded(config, body, candidates[0][1], "velocity", 0)


def rest_positions(
    config: RigidBodyMotionConfig, history: FeatureHistory, reference_tick: int, tick: int
) -> RestPositions:
    """Where features were while a body stood at its reference.

    Averages over all samples until the reference, or, where the last few of these disagree with
    that (the body was nudged before), over these few.
    """
    last = history.p_W.shape[1] - 1 - (tick - reference_tick)
    before = history.rest_until <= reference_tick
    long = displacements(history, newest=0, use_rest=before, last_old=last)
    p, C = long.p_old, long.C_old
    short = displacements(
        history,
        newest=0,
        use_rest=np.zeros(len(before), bool),
        first_old=last + 1 - whole_ticks(config.history.nudge_time, config.period),
        last_old=last,
    )
    valid = (long.count_old >= 3) & (short.count_old >= 2)
    if valid.any():
        distance, _ = squared_distances(
            short.p_old[valid] - p[valid], short.C_old[valid] + C[valid]
        )
        nudged = np.nonzero(valid)[0][distance > GATE]
        p[nudged], C[nudged] = short.p_old[nudged], short.C_old[nudged]
    C = C + config.landmarks.floor**2 * np.eye(3)
    return RestPositions(ids=history.ids[valid], p_WF=p[valid], covariance=C[valid])


def place_landmarks(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> tuple[list[TrackedBody], FeatureHistory]:
    """The bodies with landmarks of their new features.

    How a body moved until it was reset is known roughly only, and must not judge its features: they
    keep their newest sample alone.
    """
    placed = [_with_new_landmarks(config, body, history) for body in bodies]
    for before, body in zip(bodies, placed, strict=True):
        if body.reset_count > before.reset_count:
            rows = np.nonzero(history.body == body.body_id)[0]
            history = replace(forget(history, rows, 1), body=history.body)
    return placed, history


def _with_new_landmarks(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory
) -> TrackedBody:
    """Gives landmarks to assigned features that have none, as far as there is room.

    If these are all that the body has, and none was there when it stood at its reference, its pose
    is from now on where it is believed to be, up to a constant (`BodyMotion.reset_count`).
    """
    waiting = (history.body == body.body_id) & history.seen
    waiting &= ~np.isin(history.ids, body.filter.ids)
    room = config.landmarks.max_count - len(body.filter.ids)
    if room <= 0 or not waiting.any():
        return body
    rows = np.nonzero(waiting)[0]
    _, first, rested = np.intersect1d(history.ids[rows], body.rest.ids, return_indices=True)
    late = np.setdiff1d(np.arange(len(rows)), first)
    first, rested = rows[first[:room]], rested[:room]
    filtered = body_filter.add_reference_landmarks(
        body.filter,
        history.ids[first],
        body.X_WB_reference,
        body.rest.p_WF[rested],
        body.rest.covariance[rested],
    )
    if len(first):
        p_WF, covariance = newest_samples(history, first)
        landmarks = len(body.filter.ids) + np.arange(len(first))
        fits = body_filter.agreeing(filtered, landmarks, p_WF, covariance, GATE)
        filtered = body_filter.correct(filtered, landmarks[fits], p_WF[fits], covariance[fits])
    late = rows[late[: room - len(first)]]
    p_WF, covariance = newest_samples(history, late)
    if len(filtered.ids) == 0:
        if len(late) < config.landmarks.reset_support:
            return body
        offset = body.offset + filtered.P[:6, :6]
        body = replace(body, reset_count=body.reset_count + 1, offset=offset)
        filtered = body_filter.with_known_pose(filtered)
        covariance = covariance + config.landmarks.reset_floor**2 * np.eye(3)
    filtered = body_filter.add_current_landmarks(filtered, history.ids[late], p_WF, covariance)
    path = np.concatenate([body.path[:-1], filtered.X[None]])
    return replace(body, filter=filtered, path=path)


def corrected(
    config: RigidBodyMotionConfig, body: BodyFilter, history: FeatureHistory
) -> BodyFilter:
    """The filter after the features seen now that agree with one pose."""
    landmarks, rows = _seen_landmarks(body, history)
    p_WF, covariance = newest_samples(history, rows)
    fits = body_filter.agreeing(body, landmarks, p_WF, covariance, GATE)
    return body_filter.correct(body, landmarks[fits], p_WF[fits], covariance[fits])


def is_supported(config: RigidBodyMotionConfig, body: TrackedBody) -> bool:
    """Whether a body goes on: one that was seen only briefly is given up sooner."""
    initial = whole_ticks(config.initial_patience, config.period) + body.supported
    return body.unsupported <= min(whole_ticks(config.patience, config.period), initial)


def remember_features(
    config: RigidBodyMotionConfig, state: BodyTrackerState, features: FeatureBelief
) -> FeatureHistory:
    return remember(
        state.history,
        features,
        state.tick + 1,
        floor=config.history.floor,
        memory=whole_ticks(config.history.memory, config.period),
        rest_samples=whole_ticks(config.history.rest_time, config.period),
    )
