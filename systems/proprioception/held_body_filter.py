"""The pose of the held body: predicted by the hand through the grasp, corrected by features.

The error state is described in `held_body_state`.
"""

from dataclasses import replace

import numpy as np

from crossmodal.maths import error_state, se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.gaussian import nees, outlier_gate, schmidt_update, symmetric
from crossmodal.maths.rigid_points import pose_scale
from crossmodal.maths.vectors import cross
from crossmodal.systems.port_values import GraspBelief, GraspType, PoseBelief
from crossmodal.systems.proprioception.bent_hand import (
    BentHand,
    free_motion,
    line_sensitivity,
    screw,
)
from crossmodal.systems.proprioception.held_body_state import (
    BodyState,
    HeldBodyMotionConfig,
    Layout,
)

_LOOSE_TYPES = (GraspType.REVOLUTE, GraspType.CYLINDRICAL)
_POSE = slice(0, 6)
_UNLIKELY = outlier_gate(6)
_REFERENCE_VARIANCE = 1e-12  # Of the reference pose, known by definition, [rad^2, m^2].


def start_body(
    hand: BentHand, grasp: GraspBelief, config: HeldBodyMotionConfig, delay: float = 0.0
) -> BodyState:
    """The body at its reference: B has the world's axes and sits at the hand's origin.

    After that the hand settles on the handle, which the body does not follow. The error of this is
    largest at the reference and decays; it ends when features say where the body is.

    Args:
        delay: Since the hand has closed, [s].
    """
    reference_error = np.repeat(
        [config.reference_rotation_error, config.reference_translation_error], 3
    )
    X_WB = np.eye(4)
    X_WB[:3, 3] = hand.X_WH[:3, 3]
    layout = Layout(hand.bias_jacobian.shape[1])
    P = np.eye(layout.size)
    P[:6, :6] *= _REFERENCE_VARIANCE
    return BodyState(
        hand=hand,
        X_WB=X_WB,
        X_WB_reference=X_WB,
        x=np.zeros(layout.size),
        P=P,
        grasp_type=grasp.type,
        reference_error=np.diag(reference_error**2),
        reference_delay=delay,
    )


def shift_body(body: BodyState, shift: float, config: HeldBodyMotionConfig) -> BodyState:
    """The body after it may have moved in the fingers by `shift` since they closed, 1 sigma."""
    if shift <= body.shift:
        return body
    added = shift**2 - body.shift**2
    moved = np.diag(np.repeat([added / config.lever**2, added], 3))
    return replace(
        body,
        P=error_state.inflate(body.P, _POSE, moved),
        shift=shift,
    )


def predict_body(
    body: BodyState, hand: BentHand, grasp: GraspBelief, config: HeldBodyMotionConfig
) -> BodyState:
    """Moves the body as the hand moved, X_WH T X_WH^-1 X_WB, as far as the grasp transmits it.

    With the hand's twist tau = log(X_WH^-1(t-1) X_WH(t)) and the free projection N, the body is
    moved by T = exp((I - N) tau). The hand's errors e = J c + L n, of its bias Jacobian J and noise
    square root L, enter by what they have changed since the last tick; what stays the same moves
    the grasping axis with the hand and cancels. When another type of grasp has become the most
    likely, f and k mean something else and start from their prior.
    """
    layout = Layout(hand.bias_jacobian.shape[1])
    if grasp.type != body.grasp_type:
        x, P = error_state.fade(body.x, body.P, slice(layout.f.start, layout.k.stop), 0.0)
        body = replace(body, x=x, P=P, grasp_type=grasp.type)
    free = free_motion(grasp)
    before = body.hand
    tau = se3.log(se3.inverse(before.X_WH) @ hand.X_WH)
    followed = tau - free.projection @ tau
    step = se3.exp(followed)
    G = se3.adjoint(se3.inverse(body.X_WB) @ before.X_WH)
    now = np.eye(6) - free.projection
    turn = screw(free.axis, free.point)
    slide = np.concatenate([np.zeros(3), free.axis])
    way_H = followed[3:] + cross(followed[:3], free.point)
    turned = float(free.axis @ tau[:3])
    slid = free.axis @ (tau[3:] + cross(tau[:3], free.point))

    rho = np.exp(-config.period / config.hand.correlation_time)
    F = np.eye(layout.size)
    F[:6, layout.c] = G @ now @ (hand.bias_jacobian - before.bias_jacobian)
    F[:6, layout.n] = G @ now @ (rho * hand.noise_square_root - before.noise_square_root)
    F[layout.n, layout.n] *= rho
    F[:6, layout.f] = G @ np.column_stack([turn * turned, slide * slid]) * free.doubt
    curvature = free.looseness * config.hinge_curvature
    way_B = curvature * (G[:3, :3] @ way_H)
    F[:6, layout.k] = np.outer(G @ turn, way_B)
    against = float(np.dot(way_B, body.x[layout.k])) - turned
    slides = grasp.type == GraspType.CYLINDRICAL
    F[:6, layout.s] = G @ line_sensitivity(free, tau, against, slides) @ free.line
    noise = np.zeros((layout.size, 6))
    noise[:6] = G @ now @ hand.noise_square_root
    noise[layout.n] = np.eye(6)
    P = F @ body.P @ F.T + (1.0 - rho**2) * noise @ noise.T
    P[:6, :6] += G @ np.diag(_slip(tau, config)) @ G.T

    # A smaller noise square root does not bend the hand back: the mean error in metres stays.
    F[:6, layout.n] = (rho - 1.0) * G @ now @ before.noise_square_root
    F[layout.n, layout.n] = rho * np.linalg.solve(hand.noise_square_root, before.noise_square_root)
    x = F @ body.x
    X_WB = before.X_WH @ step @ se3.inverse(before.X_WH) @ body.X_WB @ se3.exp(x[:6])
    x[:6] = 0.0
    remains = (1.0 - body.settled) * np.exp(-config.period / config.reference_error_time)
    return replace(
        body,
        hand=hand,
        X_WB=X_WB,
        x=x,
        P=symmetric(P),
        settled=1.0 - remains,
    )


def _slip(tau: Array, config: HeldBodyMotionConfig) -> Array:
    """Variances (6,) by which the body slips in the hand while the hand moves by `tau`."""
    displacement = np.linalg.norm(tau[3:]) + config.lever * np.linalg.norm(tau[:3])
    return displacement * config.hand.slip


def with_velocity(
    body: BodyState,
    V_WH_H: Array,
    V_covariance: Array,
    grasp: GraspBelief,
    config: HeldBodyMotionConfig,
) -> BodyState:
    """Adds the velocity that the grasp transmits from the hand's, (6,) with covariance (6, 6)."""
    layout = Layout(body.hand.bias_jacobian.shape[1])
    free = free_motion(grasp)
    G = se3.adjoint(se3.inverse(body.X_WB) @ body.hand.X_WH)
    transmitted = np.eye(6) - free.projection
    V_H = transmitted @ V_WH_H
    way_B = G[:3, :3] @ (V_H[3:] + cross(V_H[:3], free.point))
    turn = G @ screw(free.axis, free.point)
    slide = G @ np.concatenate([np.zeros(3), free.axis])
    curvature = free.looseness * config.hinge_curvature
    rate = curvature * way_B @ body.x[layout.k]
    rate_variance = curvature**2 * way_B @ body.P[layout.k, layout.k] @ way_B
    rate_variance += (free.doubt[0] * (free.axis @ V_WH_H[:3])) ** 2
    slide_variance = (free.doubt[1] * (free.axis @ V_WH_H[3:])) ** 2
    noise = pose_scale(config.velocity_noise) ** 2
    covariance = (
        G @ transmitted @ V_covariance @ transmitted.T @ G.T
        + rate_variance * np.outer(turn, turn)
        + slide_variance * np.outer(slide, slide)
        + G @ np.diag(noise) @ G.T
    )
    return replace(body, V=G @ V_H + turn * rate, V_covariance=symmetric(covariance))


def reset_body(
    body: BodyState,
    seen: PoseBelief,
    feature_ids: Ids,
    reset_count: int,
) -> BodyState:
    """The body when features are back that were placed in it where the hand had carried it.

    They know nothing of the pose's error until then, but say how the body moves from now on: that
    error becomes a constant `offset`, and the pose is where they see it, up to their noise. Of the
    reference's error, what has settled stays.
    """
    layout = Layout(body.hand.bias_jacobian.shape[1])
    x, P = error_state.fade(body.x, body.P, layout.b, 0.0)
    offset = body.offset + P[:6, :6]
    P = error_state.reset(P, _POSE, seen.covariance)
    return replace(
        body,
        X_WB=seen.X,
        x=x,
        P=P,
        feature_ids=feature_ids,
        reference_error=np.zeros((6, 6)),
        reset_count=reset_count,
        offset=offset,
        reference_offset=body.reference_offset + body.settled**2 * body.reference_error,
    )


def correct_body(
    body: BodyState,
    seen: PoseBelief,
    offset_covariance: Array,
    feature_ids: Ids,
    config: HeldBodyMotionConfig,
) -> BodyState | None:
    """Corrects by the pose that the features show, seen = X_WB exp(xi + offset b + noise).

    Landmarks are wrong independently of each other, so that the means of two sets of n and m, of
    which k are in both, are correlated by k / sqrt(n m): so far the offset stays as it was at the
    last tick that saw any. The grasp learns from vision too, so its line's error is another one
    from now on. An innovation that
    nothing explains means that the body slipped: the pose's covariance grows first. Only features
    seen before can show that; with too few of them, the features lie on something else: None.
    """
    layout = Layout(body.hand.bias_jacobian.shape[1])
    common = np.intersect1d(feature_ids, body.feature_ids).size
    kept = common / np.sqrt(max(1, len(feature_ids) * len(body.feature_ids)))
    x, P = error_state.fade(body.x, body.P, layout.b, kept)
    x, P = error_state.fade(x, P, layout.s, 0.0)
    H = np.zeros((6, layout.size))
    H[:, :6] = np.eye(6)
    H[:, layout.b] = np.linalg.cholesky(offset_covariance)
    P = error_state.inflate(P, _POSE, body.since_reference.covariance - body.pose.covariance)
    innovation = se3.log(se3.inverse(body.X_WB) @ seen.X) - H @ x
    if nees(innovation, H @ P @ H.T + seen.covariance) > _UNLIKELY:
        if common < config.retained_share * len(feature_ids):
            return None
        P = error_state.inflate(P, _POSE, np.diag(pose_scale(config.jump) ** 2))
    considered = np.zeros(layout.size, dtype=np.bool_)
    considered[layout.f] = True
    considered[layout.b] = True
    considered[layout.k] = body.grasp_type not in _LOOSE_TYPES
    correction, P = schmidt_update(P, H, seen.covariance, innovation, considered)
    x = x + correction
    X_WB = body.X_WB @ se3.exp(x[:6])
    x[:6] = 0.0
    return replace(
        body,
        X_WB=X_WB,
        x=x,
        P=P,
        feature_ids=feature_ids,
        reference_error=np.zeros((6, 6)),
    )
