"""Rigid bodies from point features, one tick at a time: pure functions."""

from dataclasses import dataclass, field, replace

import numpy as np

from maths import se3
from systems.port_values import (
    INTERACTED_BODY,
    STATIC_BODY,
    Array,
    BodyPredictions,
    FeatureBelief,
    Ids,
    PoseBelief,
)
from systems.vision import body_filter
from systems.vision.body_filter import BodyFilter
from systems.vision.feature_history import (
    OUTCAST,
    FeatureHistory,
    Mask,
    displacements,
    no_history,
    remember,
    squared_distances,
)


@dataclass(kw_only=True)
class RigidBodyMotionConfig:
    """How bodies are found, followed and given up."""

    period: float = 1.0 / 15.0  # Update period, [s].
    window: int = 30  # Ticks of each feature's history, [ticks].
    memory: int = 45  # An unseen feature is forgotten after so many, [ticks].
    rest_samples: float = 60.0  # Samples that average at most into a feature's rest.
    newest: int = 3  # Ticks that make a feature's newest position, [ticks].
    feature_floor: float = 2e-4  # Added to a feature's standard deviation, [m].
    anchor_floor: float = 3e-4  # Error of an anchor that averaging does not remove, [m].
    anchor_walk: float = 5e-5  # Drift of an anchor, [m/sqrt(s)].
    turn_walk: float = 3e-4  # The same per turn of its body, [m/sqrt(rad)].
    angular_acceleration: float = 1e-2  # Spectral density, [rad^2/s^3].
    linear_acceleration: float = 2.5e-3  # Spectral density, [m^2/s^3].
    initial_angular_velocity: float = 0.1  # Standard deviation at the reference, [rad/s].
    initial_linear_velocity: float = 0.02  # Standard deviation at the reference, [m/s].
    gate: float = 16.27  # Squared Mahalanobis distance of 3 dof that 0.1 % exceed.
    moving: float = 20.0  # The same beyond which a feature does not stand still.
    better: float = 9.0  # By how much a motion fits a feature better to support it.
    association: float = 8.0  # Log likelihood ratio that assigns a feature, or releases it.
    extent: float = 0.05  # Distance to a body's features that counts as one deviation, [m].
    max_penalty: float = 30.0  # Log likelihood ratio that distance costs at most.
    min_support: int = 6  # Features that a new body needs.
    min_gain: float = 120.0  # Their summed gain in squared distance over standing still.
    min_spread: float = 0.015  # Root mean square distance from their centroid, [m].
    keep_support: int = 3  # Features that a body needs to live on.
    merging_share: float = 0.8  # Of a body's telling features that make it part of an older one.
    patience: int = 30  # Ticks that it lives without, less if it had it for less, [ticks].
    neighbourhood: float = 0.08  # Where a new body's features outnumber all others, [m].
    max_anchors: int = 50  # Features that a body's filter holds.
    max_suspicion: int = 8  # A feature that disagrees for so long with its body leaves it, [ticks].
    max_free_suspicion: int = 45  # A free one, or one that left, starts afresh, [ticks].
    rotation_sigma: float = 0.1  # Prior rotation of a new body's first motion, [rad].
    jump_rotation: float = 0.1  # Unpredicted turn that is believed if features agree, [rad].
    jump_translation: float = 0.03  # The same for a shift, [m].
    prior_rotation_walk: float = 0.05  # Of the prior while no feature is seen, [rad/sqrt(s)].
    prior_translation_walk: float = 0.01  # The same, [m/sqrt(s)].
    adoption_way: float = 0.003  # Of the hand before a body may turn out to be held by it, [m].
    seed: int = 0  # Of RANSAC.


@dataclass(kw_only=True)
class RestPositions:
    """Where features were before a body moved: ids (K,), p_WF (K, 3), covariance (K, 3, 3)."""

    ids: Ids
    p_WF: Array
    covariance: Array


def no_rest() -> RestPositions:
    return RestPositions(
        ids=np.zeros(0, np.int64), p_WF=np.zeros((0, 3)), covariance=np.zeros((0, 3, 3))
    )


@dataclass(kw_only=True)
class TrackedBody:
    """One body's filter and recent past; never written after it is made.

    Attributes:
        body_id: Its number.
        filter: Belief about pose, velocity and anchors.
        X_WB_reference: Pose (4, 4) at the reference.
        reference_tick: The last tick at which it is known to have stood there.
        rest: Positions until then of all features that existed, whosoever they are.
        path: X_WB over the window (H, 4, 4), newest last.
        support: Features that agreed with it at this tick.
        supported: Ticks with at least `keep_support`.
        unsupported: Ticks since then.
        source: Which prediction fitted best at this tick.
        held_since: Tick at which the hand had closed, of the interacted body; -1 for others.
    """

    body_id: int
    filter: BodyFilter
    X_WB_reference: Array
    reference_tick: int
    rest: RestPositions
    path: Array
    support: int = 0
    supported: int = 0
    unsupported: int = 0
    source: str = "reference"
    held_since: int = -1

    def __deepcopy__(self, memo: dict[int, object]) -> "TrackedBody":
        return self


@dataclass(kw_only=True)
class BodyLevel:
    """Everything the body level remembers."""

    tick: int
    next_id: int
    history: FeatureHistory
    bodies: list[TrackedBody] = field(default_factory=list)

    def __deepcopy__(self, memo: dict[int, object]) -> "BodyLevel":
        return self


def no_bodies(config: RigidBodyMotionConfig) -> BodyLevel:
    return BodyLevel(tick=-1, next_id=2, history=no_history(config.window))


def predict(config: RigidBodyMotionConfig, body: BodyFilter) -> BodyFilter:
    """The filter one tick later, by its velocity."""
    acceleration = np.repeat([config.angular_acceleration, config.linear_acceleration], 3)
    return body_filter.predict(
        body, config.period, acceleration, config.anchor_walk, config.turn_walk
    )


def _seen_anchors(body: BodyFilter, history: FeatureHistory) -> tuple[Ids, Ids]:
    """Indices of the anchors whose features are seen now, and of these in the history."""
    _, anchors, rows = np.intersect1d(body.ids, history.ids, return_indices=True)
    seen = history.seen[rows]
    return anchors[seen], rows[seen]


def newest_samples(history: FeatureHistory, rows: Ids) -> tuple[Array, Array]:
    """Positions (K, 3) and covariances (K, 3, 3) of features that are seen now."""
    return history.p_W[rows, -1], np.linalg.inv(history.information[rows, -1])


def robust_likelihood(
    config: RigidBodyMotionConfig, body: BodyFilter, anchors: Ids, p_WF: Array, covariance: Array
) -> float:
    """Log likelihood, up to a constant, of features at a pose; outliers count as on the gate."""
    z, R_B = body_filter.in_body(body.X, p_WF, covariance)
    S = body_filter.innovation_blocks(body, anchors, R_B)
    distance, log_determinant = squared_distances(z - body.p_BF[anchors], S)
    return -0.5 * float(np.sum(np.minimum(distance, config.gate) + log_determinant))


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
        predictions: Other accounts of its pose now, (source, X_WB (4, 4)).

    Returns:
        The body, and the rows of the history that agreed and disagreed.
    """
    old = body_filter.remove_anchors(body.filter, np.setdiff1d(body.filter.ids, history.ids))
    predicted = predict(config, old)
    candidates = [("velocity", predicted), ("still", replace(predicted, X=old.X, V=np.zeros(6)))]
    for source, X_WB in predictions:
        V = se3.log(se3.inverse(old.X) @ X_WB) / config.period
        candidates.append((source, replace(predicted, X=X_WB, V=V)))
    anchors, rows = _seen_anchors(predicted, history)
    if len(rows) == 0:
        return _coasted(config, body, old, candidates), rows, rows
    p_WF, covariance = newest_samples(history, rows)
    scores = [robust_likelihood(config, c, anchors, p_WF, covariance) for _, c in candidates]
    source, chosen = candidates[int(np.argmax(scores))]
    chosen, fits = _agreeing(config, chosen, anchors, p_WF, covariance)
    if body.unsupported > 0 and np.sum(fits) < config.keep_support:
        # While the pose is uncertain, any one feature would fit.
        return _coasted(config, body, old, candidates), rows[:0], rows
    filtered = body_filter.correct(chosen, anchors[fits], p_WF[fits], covariance[fits])
    moved = _recorded(config, body, filtered, source, int(np.sum(fits)))
    return moved, rows[fits], rows[~fits]


def _agreeing(
    config: RigidBodyMotionConfig,
    body: BodyFilter,
    anchors: Ids,
    p_WF: Array,
    covariance: Array,
) -> tuple[BodyFilter, Mask]:
    """The features that agree; where most do not, after a jump of the pose, if they do then."""
    fits = body_filter.agreeing(body, anchors, p_WF, covariance, config.gate)
    if len(fits) < config.min_support or np.mean(fits) > 0.5:
        return body, fits
    sigma = np.repeat([config.jump_rotation, config.jump_translation], 3)
    jumped = body_filter.inflated(body, sigma)
    again = body_filter.agreeing(jumped, anchors, p_WF, covariance, config.gate)
    return (jumped, again) if np.mean(again) > 0.6 else (body, fits)


def _recorded(
    config: RigidBodyMotionConfig,
    body: TrackedBody,
    filtered: BodyFilter,
    source: str,
    support: int,
) -> TrackedBody:
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
    """Without features: follow the interacted body's prior, else the velocity."""
    for source, candidate in candidates:
        if source == "prior":
            walk = np.repeat([config.prior_rotation_walk, config.prior_translation_walk], 3)
            moved = body_filter.carried(old, candidate.X, config.period, walk)
            return _recorded(config, body, moved, source, 0)
    return _recorded(config, body, candidates[0][1], "velocity", 0)


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
        first_old=last - 4,
        last_old=last,
    )
    valid = (long.count_old >= 3) & (short.count_old >= 2)
    if valid.any():
        distance, _ = squared_distances(
            short.p_old[valid] - p[valid], short.C_old[valid] + C[valid]
        )
        nudged = np.nonzero(valid)[0][distance > config.gate]
        p[nudged], C[nudged] = short.p_old[nudged], short.C_old[nudged]
    C = C + config.anchor_floor**2 * np.eye(3)
    return RestPositions(ids=history.ids[valid], p_WF=p[valid], covariance=C[valid])


def with_anchors(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory
) -> TrackedBody:
    """Gives anchors to assigned features that have none, as far as there is room."""
    waiting = (history.body == body.body_id) & history.seen
    waiting &= ~np.isin(history.ids, body.filter.ids)
    room = config.max_anchors - len(body.filter.ids)
    if room <= 0 or not waiting.any():
        return body
    rows = np.nonzero(waiting)[0]
    _, first, rested = np.intersect1d(history.ids[rows], body.rest.ids, return_indices=True)
    late = np.setdiff1d(np.arange(len(rows)), first)
    first, rested = rows[first[:room]], rested[:room]
    filtered = body_filter.add_rest_anchors(
        body.filter,
        history.ids[first],
        body.X_WB_reference,
        body.rest.p_WF[rested],
        body.rest.covariance[rested],
    )
    if len(first):
        p_WF, covariance = newest_samples(history, first)
        anchors = len(body.filter.ids) + np.arange(len(first))
        fits = body_filter.agreeing(filtered, anchors, p_WF, covariance, config.gate)
        filtered = body_filter.correct(filtered, anchors[fits], p_WF[fits], covariance[fits])
    late = rows[late[: room - len(first)]]
    p_WF, covariance = newest_samples(history, late)
    filtered = body_filter.add_present_anchors(filtered, history.ids[late], p_WF, covariance)
    path = np.concatenate([body.path[:-1], filtered.X[None]])
    return replace(body, filter=filtered, path=path)


def body_against_static(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory
) -> tuple[Array, Array]:
    """Log likelihood ratios (N,) of moving with the body over standing still, and fits (N,).

    Both hypotheses explain the displacement from the earlier mean position to the newest, with the
    covariance of both means and, for the body, of its pose; zero where there is too little to tell.
    The fit is the squared Mahalanobis distance under the body.
    """
    use_rest = history.rest_until <= body.reference_tick
    moving = displacements(
        history,
        newest=config.newest,
        X_WB=body.path,
        use_rest=use_rest,
        X_WB_rest=body.X_WB_reference,
    )
    standing = displacements(history, newest=config.newest, use_rest=use_rest)
    enough = history.seen & (moving.count_new >= 2) & (moving.count_old >= 4)
    ratio, fit = np.zeros(len(enough)), np.full(len(enough), np.inf)
    if not enough.any():
        return ratio, fit
    floor = config.feature_floor**2 * np.eye(3)
    J = body_filter.pose_jacobian(moving.p_new[enough])
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
    """Assigns features to the body whose motion explains theirs, releases those it does not.

    A body is compact: the farther a feature is from its known ones, the more it takes.
    """
    if not bodies or len(history.ids) == 0:
        return history
    tests = [body_against_static(config, body, history) for body in bodies]
    ids = np.array([body.body_id for body in bodies])
    ratios = np.array([np.where(fit < config.gate, ratio, -np.inf) for ratio, fit in tests])
    distances = np.array([_distances(history, body.body_id) for body in bodies])
    ratios -= np.minimum(0.5 * (distances / config.extent) ** 2, config.max_penalty)
    best = np.argmax(ratios, axis=0)
    highest = ratios[best, np.arange(len(history.ids))]
    assigned = history.body.copy()
    joins = (history.body == STATIC_BODY) & (highest > config.association)
    for i, body_id in enumerate(ids):
        first = joins & (best == i)
        # A body that has no feature yet gets several at once, or an outlier would steer it.
        if not np.any(history.body == body_id) and np.sum(first) < config.keep_support:
            joins &= ~first
    assigned[joins] = ids[best[joins]]
    for i, (ratio, _) in enumerate(tests):
        mine = history.body == ids[i]
        assigned[mine & (ratio < -config.association)] = STATIC_BODY
        # Another moving body explains it better than its own.
        moves = mine & (highest > np.maximum(ratio, 0.0) + config.association)
        assigned[moves] = ids[best[moves]]
    changed = assigned != history.body
    return replace(history, body=assigned, suspicion=np.where(changed, 0, history.suspicion))


def merged(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> tuple[list[TrackedBody], FeatureHistory]:
    """Gives a body's features to an older one that explains the motion of nearly all of them."""
    assigned, suspicion = history.body.copy(), history.suspicion.copy()
    kept: list[TrackedBody] = []
    for body in bodies:
        mine = assigned == body.body_id
        adopted = False
        for older in kept:
            if body.reference_tick < older.held_since:
                continue  # Adoption keeps what was seen before the hand closed.
            ratio, fit = body_against_static(config, older, history)
            told = mine & (np.abs(ratio) > config.association)
            if np.sum(told) < config.keep_support or body.body_id == INTERACTED_BODY:
                continue
            shared = told & (ratio > config.association) & (fit < config.gate)
            if np.sum(shared) >= config.merging_share * np.sum(told):
                assigned[mine], suspicion[mine] = older.body_id, 0
                adopted = True
                break
        if not adopted:
            kept.append(body)
    return kept, replace(history, body=assigned, suspicion=suspicion)


def without_strays(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> list[TrackedBody]:
    """Removes the anchors of features that do not belong to the body, and what they did to it."""
    kept = []
    for body in bodies:
        strays = body.filter.ids[
            np.isin(body.filter.ids, history.ids[history.body != body.body_id])
        ]
        if len(strays):
            sigma = np.repeat([config.jump_rotation, config.jump_translation], 3)
            filtered = body_filter.rebuilt(body_filter.remove_anchors(body.filter, strays), sigma)
            body = replace(body, filter=corrected(config, filtered, history))
        kept.append(body)
    return kept


def corrected(
    config: RigidBodyMotionConfig, body: BodyFilter, history: FeatureHistory
) -> BodyFilter:
    """The filter after the features seen now that agree with one pose."""
    anchors, rows = _seen_anchors(body, history)
    p_WF, covariance = newest_samples(history, rows)
    fits = body_filter.agreeing(body, anchors, p_WF, covariance, config.gate)
    return body_filter.correct(body, anchors[fits], p_WF[fits], covariance[fits])


def cast_out(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> FeatureHistory:
    """Takes features from bodies that they disagreed with or slid on; they are ignored a while."""
    slid = np.zeros(len(history.ids), bool)
    for body in bodies:
        drifted = body.filter.ids[body_filter.drifted(body.filter, config.gate)]
        slid |= (history.body == body.body_id) & np.isin(history.ids, drifted)
    outcast = history.body == OUTCAST
    worn = ~outcast & (history.body != STATIC_BODY) & (history.suspicion >= config.max_suspicion)
    suspicion = np.where(outcast, history.suspicion + 1, history.suspicion)
    return replace(
        history,
        body=np.where(worn | slid, OUTCAST, history.body),
        suspicion=np.where(worn | slid, 0, suspicion),
    )


def afresh(
    config: RigidBodyMotionConfig, bodies: list[TrackedBody], history: FeatureHistory
) -> FeatureHistory:
    """Frees features whose body ended, or that have been suspicious for long.

    All their samples but the newest are forgotten.
    """
    numbers = [STATIC_BODY, OUTCAST, *(body.body_id for body in bodies)]
    unbound = (history.body == STATIC_BODY) | (history.body == OUTCAST)
    rows = unbound & (history.suspicion >= config.max_free_suspicion)
    rows |= ~np.isin(history.body, numbers)
    if not rows.any():
        return history
    information = history.information.copy()
    information[rows, :-1] = 0.0
    return replace(
        history,
        body=np.where(rows, STATIC_BODY, history.body),
        information=information,
        rest_information=np.where(rows[:, None, None], 0.0, history.rest_information),
        rest_moment=np.where(rows[:, None], 0.0, history.rest_moment),
        rest_until=np.where(rows, -1, history.rest_until),
        suspicion=np.where(rows, 0, history.suspicion),
    )


def interacted_body(
    config: RigidBodyMotionConfig, prior: PoseBelief, history: FeatureHistory, tick: int
) -> TrackedBody:
    """The interacted body at its first tick, which is its reference."""
    sigma = np.repeat([config.initial_angular_velocity, config.initial_linear_velocity], 3)
    return TrackedBody(
        body_id=INTERACTED_BODY,
        filter=body_filter.at_reference(prior.X, sigma),
        X_WB_reference=prior.X,
        reference_tick=tick,
        rest=rest_positions(config, history, tick, tick),
        path=np.tile(prior.X, (config.window, 1, 1)),
        source="prior",
        held_since=tick,
    )


def follow_prior(
    config: RigidBodyMotionConfig, body: TrackedBody, prior: PoseBelief
) -> TrackedBody:
    """The interacted body before it has any feature: it is where the prior says."""
    sigma = np.repeat([config.initial_angular_velocity, config.initial_linear_velocity], 3)
    filtered = body_filter.at_reference(prior.X, sigma)
    filtered.P[:6, :6] = prior.covariance
    V = se3.log(se3.inverse(body.filter.X) @ prior.X) / config.period
    return _recorded(config, body, replace(filtered, V=V), "prior", 0)


def is_active(prior: PoseBelief | None) -> bool:
    """Whether the interacted body exists; without one the prior's numbers are not finite."""
    if prior is None:
        return False
    return bool(np.isfinite(prior.X).all() and np.isfinite(prior.covariance).all())


def is_alive(config: RigidBodyMotionConfig, body: TrackedBody) -> bool:
    """Whether a body goes on: one that was seen only briefly is given up sooner."""
    patience = min(config.patience, 5 + body.supported)
    return body.body_id == INTERACTED_BODY or body.unsupported <= patience


def advance_all(
    config: RigidBodyMotionConfig,
    level: BodyLevel,
    history: FeatureHistory,
    joints: BodyPredictions,
    prior: PoseBelief | None,
) -> tuple[list[TrackedBody], FeatureHistory]:
    """All bodies at this tick, the interacted one too, and their features' suspicion."""
    suspicion = history.suspicion.copy()
    bodies = []
    for body in level.bodies:
        predictions = [
            (p.source, p.pose.X) for p in joints.predictions if p.body_id == body.body_id
        ]
        if body.body_id == INTERACTED_BODY:
            if prior is None or not is_active(prior):
                continue
            if len(np.intersect1d(body.filter.ids, history.ids)) == 0:
                bodies.append(follow_prior(config, body, prior))
                continue
            predictions.append(("prior", prior.X))
        moved, agreed, disagreed = advance(config, body, history, predictions)
        suspicion[agreed] = 0
        suspicion[disagreed] += 1
        bodies.append(moved)
    history = replace(history, suspicion=suspicion)
    known = any(body.body_id == INTERACTED_BODY for body in bodies)
    if prior is not None and is_active(prior) and not known:
        bodies.insert(0, interacted_body(config, prior, history, level.tick + 1))
    return bodies, history


def remember_features(
    config: RigidBodyMotionConfig, level: BodyLevel, features: FeatureBelief
) -> FeatureHistory:
    return remember(
        level.history,
        features,
        level.tick + 1,
        floor=config.feature_floor,
        memory=config.memory,
        rest_samples=config.rest_samples,
    )
