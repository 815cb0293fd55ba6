"""The pose of the held body: predicted by the hand through the grasp, corrected by features.

Error state, all but the first in units of their own standard deviation:

    xi  (6,)  pose error, X_WB,true = X_WB exp(xi)
    c   (m,)  constants of the episode: the calibration offset of the encoders
    n   (6,)  rest of the bent hand's pose error, a Gauss-Markov process
    b   (6,)  error of the landmarks, as a pose error in B
    f   (2,)  share of the hand's turning about the grasping axis, and of its sliding along it, that
              the body follows against what the likeliest grasp says; a constant, only considered
    k   (3,)  turn of the body about the axis per way of its handle, if the grasp lets it; a
              constant, as the body of a hinge turns by one radian per radius; only considered
              unless the likeliest grasp lets it
    s   (6,)  error of the grasping axis and of the point on it; constant as long as nobody sees

The constants make the displacement's error honest over time: they are the same at every tick, so
they grow with the way that the hand has moved and do not average away. Vision, while it lasts,
measures them too, and so improves what proprioception says in the dark. What the grasp transmits
is learnt by the grasp model alone: states that are only considered make the pose less certain and
are not corrected.
"""

from dataclasses import dataclass, replace

import numpy as np

from maths import error_state, se3
from maths.arrays import Array, Ids
from maths.gaussian import nees, schmidt_update, symmetric
from maths.immutable import Immutable
from maths.vectors import cross
from systems.port_values import GraspBelief, GraspType, PoseBelief
from systems.proprioception.bent_hand import BentHand, screw

_LOOSE_TYPES = (GraspType.REVOLUTE, GraspType.CYLINDRICAL)
_POSE = slice(0, 6)
_REFERENCE_VARIANCE = 1e-12  # The reference pose is so by definition, [rad^2, m^2].


@dataclass(kw_only=True)
class HeldBodyMotionConfig:
    period: float = 1.0 / 15.0  # Update period, [s].
    hand_correlation_time: float = 30.0  # Of the bent hand's error, a Gauss-Markov process, [s].
    slip_rotation: float = 0.03  # Slip in the hand, a random walk over its way, [rad/m^0.5].
    slip_translation: float = 2.0e-3  # The same for the translation, [m/m^0.5].
    reference_rotation_error: float = 0.05  # Unseen settling after the reference, [rad].
    reference_translation_error: float = 6.0e-3  # The same for the translation, [m].
    reset_rotation_error: float = 0.015  # The same after new landmarks were placed, [rad].
    reset_translation_error: float = 3.0e-3  # The same for the translation, [m].
    reference_error_time: float = 2.0  # Time constant with which these errors decay, [s].
    lever: float = 0.1  # Way of the hand that counts for a turn of it, [m/rad].
    hinge_curvature: float = 3.0  # One over the radius of a hinge, 1 sigma, [rad/m].
    rotation_velocity_noise: float = 0.02  # From slip and the rate of bending, [rad/s].
    translation_velocity_noise: float = 4.0e-3  # The same for the translation, [m/s].
    minimum_features: int = 8  # Least number of features that tell a pose, [-].
    inlier_share: float = 0.5  # Least share of them that agrees on one pose, [-].
    landmark_rotation_floor: float = 2.0e-3  # Common error of the landmarks, [rad].
    landmark_translation_floor: float = 3.0e-4  # The same for the translation, [m].
    jump_gate: float = 22.5  # Squared innovation above which the grasp slipped (99.9 %), [-].
    jump_rotation: float = 0.05  # Standard deviation of such a slip, [rad].
    jump_translation: float = 0.01  # The same for the translation, [m].
    retained_share: float = 0.5  # Least share of features seen before that shows a slip, [-].


@dataclass(frozen=True)
class Layout:
    """Where the parts of the error state lie, for m constants."""

    m: int

    @property
    def size(self) -> int:
        return 29 + self.m

    @property
    def c(self) -> slice:
        return slice(6, 6 + self.m)

    @property
    def n(self) -> slice:
        return slice(6 + self.m, 12 + self.m)

    @property
    def b(self) -> slice:
        return slice(12 + self.m, 18 + self.m)

    @property
    def f(self) -> slice:
        return slice(18 + self.m, 20 + self.m)

    @property
    def k(self) -> slice:
        return slice(20 + self.m, 23 + self.m)

    @property
    def s(self) -> slice:
        return slice(23 + self.m, 29 + self.m)


@dataclass(kw_only=True)
class BodyState(Immutable):
    """Mean and covariance of the body; never written after it is made.

    Attributes:
        hand: The bent hand at the same tick.
        X_WB: (4, 4), with the reference pose X_WB_reference (4, 4).
        x: Mean (n,) of the error state; its first six are zero.
        P: Covariance (n, n).
        V: V_WB_B (6,), with covariance V_covariance (6, 6).
        feature_ids: The features seen last.
        grasp_type: The type under which f and k have their present meaning.
        unseen_growth: (6, 6), in B, by what the pose's covariance has grown since features
            corrected it; it comes from the hand's errors, which are correlated over time.
        reference_error: (6, 6), in B, of the grip's settling since the reference; zero once
            features have been seen, unless the landmarks were placed anew: then of theirs.
        reset_count: How many times vision has placed its landmarks anew.
        offset: (6, 6), in B, of the pose's constant error since then; not part of P.
    """

    hand: BentHand
    X_WB: Array
    X_WB_reference: Array
    x: Array
    P: Array
    V: Array
    V_covariance: Array
    feature_ids: Ids
    grasp_type: GraspType
    unseen_growth: Array
    reference_error: Array
    reset_count: int
    offset: Array

    @property
    def pose(self) -> PoseBelief:
        return PoseBelief(X=self.X_WB, covariance=self.P[:6, :6] + self.offset)


@dataclass(kw_only=True)
class FreeMotion:
    """What the grasp leaves free, and how sure that is.

    Attributes:
        projection: (6, 6), the free part of the hand's twist, in H.
        axis: Grasping axis (3,) in H through point (3,), [m].
        doubt: (2,) standard deviation of the share of the hand's turning and of its sliding that
            the body follows.
        looseness: Share of a hinge's turning to expect of the body, 1 sigma: one if it may turn
            about the axis, else the square root of the probability that it may.
        line: Square root (6, 6) of the covariance of axis and point; zero if neither is free.
    """

    projection: Array
    axis: Array
    point: Array
    doubt: Array
    looseness: float
    line: Array


def free_motion(grasp: GraspBelief) -> FreeMotion:
    """Reads the grasp; the likeliest type decides, the others are doubts."""
    held = max(1.0 - grasp.probabilities[GraspType.FAILED], 1e-9)
    slides = grasp.probabilities[GraspType.CYLINDRICAL] / held
    turns = slides + grasp.probabilities[GraspType.REVOLUTE] / held
    free = np.array([grasp.type != GraspType.PERFECT, grasp.type == GraspType.CYLINDRICAL])
    chance = np.clip([turns, slides], 0.0, 1.0)
    doubt = np.sqrt(np.where(free, 1.0 - chance, chance))
    if grasp.type == GraspType.FAILED:
        doubt = np.zeros(2)
    return FreeMotion(
        projection=grasp.free_motion,
        axis=grasp.axis_H,
        point=grasp.p_HA,
        doubt=doubt,
        looseness=1.0 if free[0] else float(np.sqrt(chance[0])),
        line=square_root(grasp.line_covariance) if free[0] else np.zeros((6, 6)),
    )


def square_root(covariance: Array) -> Array:
    """The symmetric square root A (n, n) of a covariance that may be singular, A A = covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def positive_part(matrix: Array) -> Array:
    """The nearest positive semidefinite matrix to a symmetric one (n, n)."""
    values, vectors = np.linalg.eigh(symmetric(matrix))
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)


def line_sensitivity(free: FreeMotion, tau: Array, turned: float, slides: bool) -> Array:
    """How an error of axis and point (6,) moves the body, in H, against the mean; (6, 6).

    Args:
        free: Axis a and point p.
        tau: The hand's twist (6,).
        turned: How much the body turns about the axis against the hand, [rad].
        slides: Whether it slides too.
    """
    a, p = free.axis, free.point
    A = np.zeros((6, 6))
    A[:3, :3] = turned * np.eye(3) - np.outer(a, tau[:3])
    A[3:, :3] = turned * se3.skew(p) - np.outer(cross(p, a), tau[:3])
    A[3:, 3:] = -turned * se3.skew(a)
    if slides:
        A[3:, :3] -= (a @ (tau[3:] + cross(tau[:3], p))) * np.eye(3)
        A[3:, :3] -= np.outer(a, tau[3:] + cross(tau[:3], p))
        A[3:, 3:] -= np.outer(a, cross(a, tau[:3]))
    return A


def start_body(hand: BentHand, grasp: GraspBelief, config: HeldBodyMotionConfig) -> BodyState:
    """The body at its reference: B has the world's axes and sits at the hand's origin.

    A hand that settles on the handle after that misleads about the body, at the reference most,
    until features say where it is.
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
        V=np.zeros(6),
        V_covariance=1e-4 * np.eye(6),
        feature_ids=np.zeros(0, dtype=np.int64),
        grasp_type=grasp.type,
        unseen_growth=np.zeros((6, 6)),
        reference_error=np.diag(reference_error**2),
        reset_count=0,
        offset=np.zeros((6, 6)),
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

    rho = np.exp(-config.period / config.hand_correlation_time)
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
    unseen_growth = positive_part(body.unseen_growth + P[:6, :6] - body.P[:6, :6])
    reference_error = (
        np.exp(-2.0 * config.period / config.reference_error_time) * body.reference_error
    )
    return replace(
        body,
        hand=hand,
        X_WB=X_WB,
        x=x,
        P=symmetric(P),
        unseen_growth=unseen_growth,
        reference_error=reference_error,
    )


def _slip(tau: Array, config: HeldBodyMotionConfig) -> Array:
    """Variances (6,) by which the body slips in the hand while the hand moves by `tau`."""
    way = np.linalg.norm(tau[3:]) + config.lever * np.linalg.norm(tau[:3])
    return way * np.repeat([config.slip_rotation**2, config.slip_translation**2], 3)


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
    noise = [config.rotation_velocity_noise**2, config.translation_velocity_noise**2]
    covariance = (
        G @ transmitted @ V_covariance @ transmitted.T @ G.T
        + rate_variance * np.outer(turn, turn)
        + slide_variance * np.outer(slide, slide)
        + G @ np.diag(np.repeat(noise, 3)) @ G.T
    )
    return replace(body, V=G @ V_H + turn * rate, V_covariance=symmetric(covariance))


def reset_body(
    body: BodyState,
    seen: PoseBelief,
    feature_ids: Ids,
    reset_count: int,
    config: HeldBodyMotionConfig,
) -> BodyState:
    """The body when features are back that were placed in it where the hand had carried it.

    They know nothing of the pose's error until then, but say how the body moves from now on: that
    error becomes a constant `offset`, and the pose is where they see it, up to their noise.
    """
    layout = Layout(body.hand.bias_jacobian.shape[1])
    x, P = error_state.fade(body.x, body.P, layout.b, 0.0)
    offset = body.offset + P[:6, :6]
    P = error_state.reset(P, _POSE, seen.covariance)
    reference_error = np.repeat([config.reset_rotation_error, config.reset_translation_error], 3)
    return replace(
        body,
        X_WB=seen.X,
        x=x,
        P=P,
        feature_ids=feature_ids,
        unseen_growth=np.zeros((6, 6)),
        reference_error=np.diag(reference_error**2),
        reset_count=reset_count,
        offset=offset,
    )


def correct_body(
    body: BodyState,
    seen: PoseBelief,
    offset_covariance: Array,
    feature_ids: Ids,
    config: HeldBodyMotionConfig,
) -> BodyState | None:
    """Corrects by the pose that the features show, seen = X_WB exp(xi + offset b + noise).

    The offset stays as far as the features are the same as at the last tick that saw any; the grasp
    learns from vision too, so its line's error is another one from now on. An innovation that
    nothing explains means that the body slipped: the pose's covariance grows first. Only features
    seen before can show that; others are on something else then: None.
    """
    layout = Layout(body.hand.bias_jacobian.shape[1])
    kept = np.isin(feature_ids, body.feature_ids).mean() if len(feature_ids) else 0.0
    x, P = error_state.fade(body.x, body.P, layout.b, float(kept))
    x, P = error_state.fade(x, P, layout.s, 0.0)
    H = np.zeros((6, layout.size))
    H[:, :6] = np.eye(6)
    H[:, layout.b] = np.linalg.cholesky(offset_covariance)
    innovation = se3.log(se3.inverse(body.X_WB) @ seen.X) - H @ x
    if nees(innovation, H @ P @ H.T + seen.covariance) > config.jump_gate:
        if kept < config.retained_share:
            return None
        jump = np.repeat([config.jump_rotation**2, config.jump_translation**2], 3)
        P = error_state.inflate(P, _POSE, np.diag(jump))
    considered = np.zeros(layout.size, dtype=np.bool_)
    considered[layout.f] = True
    considered[layout.k] = body.grasp_type not in _LOOSE_TYPES
    correction, P = schmidt_update(P, H, seen.covariance, innovation, considered)
    x = x + correction
    X_WB = body.X_WB @ se3.exp(x[:6])
    x[:6] = 0.0
    none = np.zeros((6, 6))
    reference_error = body.reference_error if body.reset_count else none
    return replace(
        body,
        X_WB=X_WB,
        x=x,
        P=P,
        feature_ids=feature_ids,
        unseen_growth=none,
        reference_error=reference_error,
    )
