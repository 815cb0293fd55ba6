"""Initiation of rigid bodies' tracks from features that stopped standing still."""

from dataclasses import replace

import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.rigid_points import pose_scale
from crossmodal.systems.port_values import STATIC_BODY, PoseBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies import body_filter, body_tracking, held_body
from crossmodal.systems.vision.bodies.body_tracker_state import (
    BodyTrackerState,
    RestPositions,
    TrackedBody,
)
from crossmodal.systems.vision.bodies.feature_displacements import (
    Displacements,
    displacements,
    squared_distances,
)
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory
from crossmodal.systems.vision.bodies.motion_consensus import Consensus, find_consensus, stillness
from crossmodal.systems.vision.bodies.rigid_body_motion_config import GATE, RigidBodyMotionConfig


def free_motion(
    config: RigidBodyMotionConfig, history: FeatureHistory
) -> tuple[Displacements, Array, Mask]:
    """The features' displacements in W, their squared distances from rest, and which are free.

    Zero where a feature is not free, not seen or too young to tell.
    """
    d = displacements(history, newest=whole_ticks(config.history.newest, config.period))
    free = (history.body == STATIC_BODY) & history.seen
    free &= (d.count_new >= 2) & (d.count_old >= 5)
    distance = np.zeros(len(free))
    if free.any():
        S = (d.C_old + d.C_new)[free] + config.history.floor**2 * np.eye(3)
        distance[free], _ = squared_distances((d.p_new - d.p_old)[free], S)
    return d, distance, free


def _subset(d: Displacements, rows: Ids, floor: float) -> Displacements:
    return Displacements(
        p_old=d.p_old[rows],
        p_new=d.p_new[rows],
        C_old=d.C_old[rows] + floor**2 * np.eye(3),
        C_new=d.C_new[rows],
        count_old=d.count_old[rows],
        count_new=d.count_new[rows],
    )


def find_moving_features(
    config: RigidBodyMotionConfig, history: FeatureHistory, tick: int
) -> tuple[FeatureHistory, Consensus | None, Ids]:
    """Free features that share a significant motion.

    Returns:
        The history with new rejection counts, the motion, and the rows of its supporters.
    """
    d, distance, free = free_motion(config, history)
    moving = free & (distance > config.initiation.motion_gate)
    rejection_count = np.where(moving, history.rejection_count + 1, history.rejection_count)
    rejection_count = np.where(free & ~moving, 0, rejection_count)
    history = replace(history, rejection_count=rejection_count)
    none = np.zeros(0, np.int64)
    if np.sum(moving) < config.initiation.min_support:
        return history, None, none
    rows = np.nonzero(free)[0]
    consensus = find_consensus(
        _subset(d, rows, config.history.floor),
        distance[rows],
        np.nonzero(moving[rows])[0],
        np.random.default_rng([0, tick]),
        gate=GATE,
        support_gate=config.initiation.support_gate,
        rotation_sigma=config.initiation.rotation_sigma,
    )
    if consensus is None:
        return history, None, none
    supporters = rows[consensus.support]
    if (
        len(supporters) < config.initiation.min_support
        or consensus.gain < config.initiation.min_gain
    ):
        return history, None, none
    p = d.p_old[supporters]
    if np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))) < config.initiation.min_spread:
        return history, None, none
    if not outnumbers(config, history, d, consensus.X, supporters):
        return history, None, none
    return history, consensus, supporters


def outnumbers(
    config: RigidBodyMotionConfig,
    history: FeatureHistory,
    d: Displacements,
    X: Array,
    supporters: Ids,
) -> bool:
    """Whether a motion's supporters are the majority around themselves.

    Patches on the seam between a body and what it moves against slide with half its motion, all of
    them alike; what they lie among tells that there is no third body.
    """
    known = history.seen & (d.count_new >= 2) & (d.count_old >= 5)
    known[supporters] = False
    others = np.nonzero(known)[0]
    error = d.p_new[others] - d.p_old[others] @ X[:3, :3].T - X[:3, 3]
    S = d.C_old[others] + d.C_new[others] + config.history.floor**2 * np.eye(3)
    against = others[squared_distances(error, S)[0] > GATE]

    def neighbours(rows: Ids) -> int:
        difference = d.p_new[supporters][:, None] - d.p_new[rows]
        return int(np.sum(np.sum(difference**2, axis=2) < config.initiation.neighbourhood**2))

    return neighbours(supporters) > neighbours(against)


def onset(
    config: RigidBodyMotionConfig, history: FeatureHistory, rows: Ids, X: Array
) -> tuple[int, bool]:
    """The last tick of the window at which the features surely stood still, and whether they did.

    Without any still tick it is the first one at which most of them were seen.
    """
    window = history.p_W.shape[1]
    newest = whole_ticks(config.history.newest, config.period)
    d = displacements(history.select(rows), newest=newest)
    motion = d.p_old @ X[:3, :3].T + X[:3, 3] - d.p_old
    share, sigma = stillness(history.p_W[rows], history.information[rows], d.p_old, motion)
    # The earlier mean may hold samples of the motion: the shares then start from an offset.
    start = np.nanmedian(share[np.isfinite(share)][:5])
    excess = np.abs(share - start) / sigma
    smooth = np.convolve(np.where(np.isfinite(excess), excess, 0.0), np.ones(2) / 2.0)[:window]
    still = np.nonzero(smooth < 3.0)[0]
    seen = np.mean(history.samples[rows], axis=0)
    last = (int(still[-1]) if len(still) else -1) - 3
    if last >= 2 and np.mean(seen[: last + 1]) > 0.3:
        return last, True
    return int(np.argmax(seen > 0.6 * seen.max())), False


def first_positions(
    config: RigidBodyMotionConfig, history: FeatureHistory, reference: int
) -> RestPositions:
    """Where features were at one tick of the window, for a body that never stood still."""
    seen = history.samples[:, reference]
    covariance = np.linalg.inv(history.information[seen, reference])
    return RestPositions(
        ids=history.ids[seen],
        p_WF=history.p_W[seen, reference],
        covariance=covariance + config.landmarks.floor**2 * np.eye(3),
    )


def new_body(
    config: RigidBodyMotionConfig,
    state: BodyTrackerState,
    history: FeatureHistory,
    rows: Ids,
    X: Array,
) -> TrackedBody:
    """A body from the features' samples: standing at its reference, then replayed until now."""
    window = history.p_W.shape[1]
    reference, stood = onset(config, history, rows, X)
    reference_tick = state.tick + 1 - (window - 1 - reference)
    if stood:
        rest = body_tracking.rest_positions(config, history, reference_tick, state.tick + 1)
    else:
        rest = first_positions(config, history.select(rows), reference)
    _, placed, of_rest = np.intersect1d(history.ids[rows], rest.ids, return_indices=True)
    placed, of_rest = placed[: config.landmarks.max_count], of_rest[: config.landmarks.max_count]
    mine = history.select(rows[placed])
    X_WB_reference = np.eye(4)
    X_WB_reference[:3, 3] = rest.p_WF[of_rest].mean(axis=0)
    sigma = pose_scale(config.dynamics.initial_velocity)
    body = body_filter.at_reference(X_WB_reference, sigma if stood else 5.0 * sigma)
    body = body_filter.add_reference_landmarks(
        body, mine.ids, X_WB_reference, rest.p_WF[of_rest], rest.covariance[of_rest]
    )
    path = np.tile(X_WB_reference, (window, 1, 1))
    stride = 1 + (window - 1 - reference) // 12
    for k in range(reference + 1, window):
        body = body_tracking.predict(config, body)
        if (window - 1 - k) % stride == 0:
            seen = np.nonzero(mine.samples[:, k])[0]
            p_WF = mine.p_W[seen, k]
            covariance = np.linalg.inv(mine.information[seen, k])
            fits = body_filter.agreeing(body, seen, p_WF, covariance, GATE)
            body = body_filter.correct(body, seen[fits], p_WF[fits], covariance[fits])
        path[k] = body.X
    return TrackedBody(
        body_id=state.next_id,
        filter=body,
        X_WB_reference=X_WB_reference,
        reference_tick=reference_tick,
        rest=rest,
        path=path,
        support=len(placed),
        source="initiation",
    )


def initiate_body(
    config: RigidBodyMotionConfig,
    state: BodyTrackerState,
    bodies: list[TrackedBody],
    history: FeatureHistory,
    prior: PoseBelief | None,
) -> tuple[list[TrackedBody], FeatureHistory, int]:
    """At most one new body; or new features of the held body if it has none."""
    history, consensus, rows = find_moving_features(config, history, state.tick + 1)
    if consensus is None:
        return bodies, history, state.next_id
    held = held_body.find_held(bodies)
    if held is not None and held_body.claims(config, held, consensus.X, prior):
        owner, next_id = held.body_id, state.next_id
    else:
        born = new_body(config, state, history, rows, consensus.X)
        bodies, owner, next_id = [*bodies, born], born.body_id, state.next_id + 1
    assigned, rejection_count = history.body.copy(), history.rejection_count.copy()
    assigned[rows], rejection_count[rows] = owner, 0
    return bodies, replace(history, body=assigned, rejection_count=rejection_count), next_id
