"""A body that vision found first turns out to be the held one."""

from dataclasses import replace

import numpy as np
import scipy.linalg

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import nees, outlier_gate
from crossmodal.maths.rigid_points import pose_scale
from crossmodal.systems.port_values import PoseBelief
from crossmodal.systems.vision.bodies.body_filter import BodyFilter
from crossmodal.systems.vision.bodies.body_tracker_state import TrackedBody
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory
from crossmodal.systems.vision.bodies.held_body import find_held
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig

_UNLIKELY = outlier_gate(6)  # Squared distance of a pose that is not the same one.


def moved_frame(body: BodyFilter, T: Array) -> BodyFilter:
    """The same body described in the frame B' with X_BB' = T (4, 4)."""
    T_inverse = se3.inverse(T)
    Ad, R = se3.adjoint(T_inverse), T_inverse[:3, :3]
    J = scipy.linalg.block_diag(Ad, Ad, *[R] * len(body.ids))
    return replace(
        body,
        X=body.X @ T,
        V=Ad @ body.V,
        p_BF=body.p_BF @ R.T + T_inverse[:3, 3],
        p_BF_initial=body.p_BF_initial @ R.T + T_inverse[:3, 3],
        initial_covariance=J[12:, 12:] @ body.initial_covariance @ J[12:, 12:].T,
        P=J @ body.P @ J.T,
    )


def smoothed_pose(path: Array, index: int) -> Array:
    """The pose (4, 4) at one tick of a path (H, 4, 4), by a parabola through its neighbours.

    A single tick's pose carries that tick's noise, which a reference would keep for good.
    """
    X = np.ascontiguousarray(path[index])
    ticks = np.arange(max(index - 4, 0), min(index + 5, len(path)))
    twists = [se3.log(se3.inverse(X) @ np.ascontiguousarray(path[k])) for k in ticks]
    at_index = np.polynomial.polynomial.polyfit(ticks - index, np.array(twists), 2)[0]
    return np.asarray(X @ se3.exp(at_index))


def displacement(body: TrackedBody, age: int) -> Array:
    """X_W(now) X_W(then)^-1 (4, 4) of a body over the last `age` ticks."""
    return np.asarray(body.path[-1] @ se3.inverse(np.ascontiguousarray(body.path[-1 - age])))


def moves_with_hand(
    config: RigidBodyMotionConfig, body: TrackedBody, held: TrackedBody, prior: PoseBelief, age: int
) -> bool:
    """Whether a body has moved since the hand closed, and as the hand's prior says.

    Both displacements are compared at the held body's frame; the body's own uncertainty is
    that since its reference, which is no less than that since the hand closed. A body that has gone
    only a part of the handle's displacement is dragged along, like a box by its lid.
    """
    X_start = np.ascontiguousarray(held.path[-1 - age])
    T = se3.inverse(np.ascontiguousarray(body.path[-1 - age])) @ X_start
    covariance = moved_frame(body.filter, T).P[:6, :6]
    X_seen = displacement(body, age) @ X_start
    moved = se3.log(se3.inverse(X_start) @ X_seen)
    error = se3.log(se3.inverse(X_seen) @ prior.X)
    slack = pose_scale(config.held_body.prior_walk)
    moved_by = np.linalg.norm(prior.X[:3, 3] - X_start[:3, 3])
    missed = np.linalg.norm(prior.X[:3, 3] - X_seen[:3, 3])
    return bool(
        nees(moved, covariance) > _UNLIKELY
        and nees(error, covariance + prior.covariance + np.diag(slack**2)) < _UNLIKELY
        and moved_by > config.held_body.identification_displacement
        and missed < config.held_body.identification_share * moved_by
    )


def identify_held_body(
    config: RigidBodyMotionConfig,
    bodies: list[TrackedBody],
    history: FeatureHistory,
    prior: PoseBelief | None,
    tick: int,
) -> tuple[list[TrackedBody], FeatureHistory]:
    """Makes a body that moves with the hand the held one.

    Closing the hand nudges the object, so that vision has often found a body before the hand
    holds it. Its filter goes on in the held body's frame, which is where the prior's was when the
    hand had closed.
    """
    held = find_held(bodies)
    if held is None or prior is None or not np.isfinite(prior.X).all():
        return bodies, history
    age = tick - held.held_since
    if not 0 < age < len(held.path):
        return bodies, history
    for body in bodies:
        seen_longer = len(body.filter.ids) > len(held.filter.ids)
        if body is held or not seen_longer:
            continue
        if moves_with_hand(config, body, held, prior, age):
            index = len(body.path) - 1 - age
            T = se3.inverse(smoothed_pose(body.path, index)) @ held.path[index]
            Ad = se3.adjoint(se3.inverse(T))
            identified = replace(
                body,
                body_id=held.body_id,
                filter=moved_frame(body.filter, T),
                X_WB_reference=body.X_WB_reference @ T,
                path=body.path @ T,
                held_since=held.held_since,
                offset=Ad @ body.offset @ Ad.T,
            )
            mine = history.body == body.body_id
            others = [other for other in bodies if other is not body and other is not held]
            assigned = np.where(mine, held.body_id, history.body)
            return [identified, *others], replace(history, body=assigned)
    return bodies, history
