"""What sets the held body apart from others: the hand's prior predicts where it is.

Features join it when the hand's motion explains theirs. What the hand carries unseen is known
roughly only, so that features of a neighbour may fit it one by one: several rules keep these out.
"""

from dataclasses import replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.gaussian import chi_square_gate, outlier_gate
from crossmodal.maths.rigid_points import pose_jacobian, pose_scale
from crossmodal.systems.port_values import HELD_BODY, STATIC_BODY, PoseBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies import body_filter, body_tracking
from crossmodal.systems.vision.bodies.body_tracker_state import TrackedBody
from crossmodal.systems.vision.bodies.feature_displacements import displacements, squared_distances
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory, forget
from crossmodal.systems.vision.bodies.rigid_body_motion_config import GATE, RigidBodyMotionConfig

# Squared distance by which one in twenty features at rest seems to have been nudged.
_NUDGED = chi_square_gate(0.05, 3)
_UNLIKELY = outlier_gate(6)  # Squared distance of a pose that is not the same one.


def is_held(body: TrackedBody) -> bool:
    """Whether a body is the one that the hand holds."""
    return body.body_id == HELD_BODY


def find_held(bodies: list[TrackedBody]) -> TrackedBody | None:
    """The held body, None where there is none."""
    return next((body for body in bodies if is_held(body)), None)


def is_active(prior: PoseBelief | None) -> bool:
    """Whether the hand holds a body; without one the prior's numbers are not finite."""
    if prior is None:
        return False
    return bool(np.isfinite(prior.X).all() and np.isfinite(prior.covariance).all())


def start(
    config: RigidBodyMotionConfig, prior: PoseBelief, history: FeatureHistory, tick: int
) -> TrackedBody:
    """The held body at its first tick, which is its reference."""
    return TrackedBody(
        body_id=HELD_BODY,
        filter=body_filter.at_reference(prior.X, pose_scale(config.dynamics.initial_velocity)),
        X_WB_reference=prior.X,
        reference_tick=tick,
        rest=body_tracking.rest_positions(config, history, tick, tick),
        path=np.tile(prior.X, (history.p_W.shape[1], 1, 1)),
        source="prior",
        held_since=tick,
    )


def follow_prior(
    config: RigidBodyMotionConfig, body: TrackedBody, prior: PoseBelief
) -> TrackedBody:
    """The held body without any feature: it is where the prior says."""
    filtered = body_filter.at_reference(prior.X, pose_scale(config.dynamics.initial_velocity))
    filtered.P[:6, :6] = prior.covariance
    V = se3.log(se3.inverse(body.filter.X) @ prior.X) / config.period
    return body_tracking.recorded(config, body, replace(filtered, V=V), "prior", 0)


def advance(
    config: RigidBodyMotionConfig,
    body: TrackedBody,
    history: FeatureHistory,
    predictions: list[tuple[str, Array]],
    prior: PoseBelief,
) -> tuple[TrackedBody, Ids, Ids]:
    """One tick of the held body, see `body_tracking.advance`; the prior predicts it too."""
    if len(np.intersect1d(body.filter.ids, history.ids)) == 0:
        none = np.zeros(0, np.int64)
        return follow_prior(config, body, prior), none, none
    return body_tracking.advance(config, body, history, [*predictions, ("prior", prior.X)])


def without_nudges(config: RigidBodyMotionConfig, history: FeatureHistory) -> FeatureHistory:
    """Forgets where free features were before they moved within the window's last ticks.

    Closing the hand moves more than what it will hold. None of that is motion with the hand, which
    counts from then on only.
    """
    window = history.p_W.shape[1]
    ticks = whole_ticks(config.history.nudge_time, config.period)
    free = history.body == STATIC_BODY
    before = displacements(history, newest=0, last_old=window - 1)
    now = displacements(
        history, newest=0, use_rest=np.zeros(len(free), bool), first_old=window - ticks
    )
    known = np.nonzero(free & (before.count_old >= ticks) & (now.count_old >= 2))[0]
    if len(known) == 0:
        return history
    S = now.C_old[known] + before.C_old[known]
    distance, _ = squared_distances(now.p_old[known] - before.p_old[known], S)
    rows = known[distance > _NUDGED]
    return forget(history, rows, ticks)


def claims(
    config: RigidBodyMotionConfig, body: TrackedBody, X: Array, prior: PoseBelief | None
) -> bool:
    """Whether features that moved by X (4, 4) since the reference may be the held body's first."""
    if prior is None or body.support:
        return False
    error = se3.log(se3.inverse(X @ body.X_WB_reference) @ prior.X)
    S = prior.covariance + np.diag(pose_scale(config.held_body.prior_walk) ** 2)
    return bool(error @ np.linalg.solve(S, error) < _UNLIKELY)


def takes_handle_along(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory, rows: Ids
) -> bool:
    """Whether features that would join the held body move its handle as the hand does.

    A body that the hand alone has carried for a while is known roughly, so that a neighbour's
    features (the box under the lid that is being closed) may fit it one by one. Together they show
    their own rigid motion; what that makes of the handle must agree with the hand, which knows the
    handle's way to some millimetres whatever the body's rotation is.
    """
    moved = displacements(
        history.select(rows),
        newest=whole_ticks(config.history.newest, config.period),
        X_WB=body.path,
        use_rest=np.zeros(len(rows), bool),
        X_WB_rest=body.X_WB_reference,
    )
    known = (moved.count_new >= 2) & (moved.count_old >= 4)
    if np.sum(known) < config.keep_support:
        return True
    J = pose_jacobian(moved.p_new[known]).reshape(-1, 6)  # B sits at the handle.
    displacement = (moved.p_new - moved.p_old)[known].reshape(-1)
    information = J.T @ J
    twist = np.linalg.lstsq(information, J.T @ displacement, rcond=1e-9)[0]
    residual = displacement - J @ twist
    variance = max(float(np.mean(residual**2)), config.held_body.handle_noise**2)
    covariance = variance * np.linalg.pinv(information)[3:, 3:]
    covariance += config.held_body.handle_error**2 * np.eye(3)
    return bool(twist[3:] @ np.linalg.solve(covariance, twist[3:]) < GATE)


def accepts(
    config: RigidBodyMotionConfig, body: TrackedBody, history: FeatureHistory, rows: Ids
) -> bool:
    """Whether features may join a body; the held one asks that they take its handle along.

    Only features that would outnumber those which support the held body have to show it.
    """
    if not is_held(body) or len(rows) <= body.support:
        return True
    return takes_handle_along(config, body, history, rows)


def without_refused(
    config: RigidBodyMotionConfig,
    bodies: list[TrackedBody],
    history: FeatureHistory,
    ratios: Array,
) -> Array:
    """The log likelihood ratios (M, N) of the bodies, -inf where the held one refuses a feature."""
    best = np.argmax(ratios, axis=0)
    wants = ratios[best, np.arange(len(history.ids))] > config.association.log_ratio
    wants &= history.body != HELD_BODY
    for i, body in enumerate(bodies):
        rows = np.nonzero(wants & (best == i))[0]
        if not accepts(config, body, history, rows):
            ratios = ratios.copy()
            ratios[i, rows] = -np.inf
    return ratios


def is_blind(config: RigidBodyMotionConfig, body: TrackedBody) -> bool:
    """Whether the hand alone has carried a body for so long that any one feature would fit it.

    Only features that share a rigid motion can tell then.
    """
    if not is_held(body) or body.support >= config.keep_support:
        return False
    variance = np.diagonal(body.filter.P)[:6]
    return bool(
        np.sum(variance[:3]) > config.held_body.blind_rotation**2
        or np.sum(variance[3:]) > config.held_body.blind_translation**2
    )


def may_absorb(config: RigidBodyMotionConfig, older: TrackedBody, body: TrackedBody) -> bool:
    """Whether a body may turn out to be a part of an older one."""
    if is_held(body) or body.reference_tick < older.held_since:
        # Identification decides: it keeps the features that were seen before the hand closed.
        return False
    # An unseen body in the hand may be anywhere, other than one that was seen for long.
    return not (is_held(older) and body.supported > len(body.path))


def is_at_hand(config: RigidBodyMotionConfig, body: TrackedBody, prior: PoseBelief) -> bool:
    """Whether the held body's features leave its handle where the hand holds it."""
    R_BW = prior.X[:3, :3].T
    error = R_BW @ (body.filter.X[:3, 3] - prior.X[:3, 3])
    turned = R_BW @ body.filter.X[:3, :3]
    S = prior.covariance[3:, 3:] + turned @ body.filter.P[3:6, 3:6] @ turned.T
    S = S + config.held_body.prior_walk**2 * np.eye(3)
    return bool(error @ np.linalg.solve(S, error) < GATE)


def without_features_of_others(
    config: RigidBodyMotionConfig,
    bodies: list[TrackedBody],
    history: FeatureHistory,
    prior: PoseBelief | None,
) -> tuple[list[TrackedBody], FeatureHistory]:
    """Frees the held body's features if they take its handle out of the hand.

    They are another body's then, and the held body is where the hand has it.
    """
    if prior is None or not is_active(prior):
        return bodies, history
    kept = []
    for body in bodies:
        if is_held(body) and not is_at_hand(config, body, prior):
            rows = np.nonzero(history.body == HELD_BODY)[0]
            history = forget(history, rows, 1)
            before = replace(body.filter, X=np.ascontiguousarray(body.path[-2]))
            alone = follow_prior(config, replace(body, filter=before), prior)
            body = replace(alone, path=np.concatenate([body.path[:-1], prior.X[None]]))
        kept.append(body)
    return kept, history
