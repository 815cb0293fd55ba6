"""Tracked rigid bodies: configuration and memory."""

from dataclasses import dataclass, field

from maths.arrays import Array, Ids
from maths.immutable import Immutable
from systems.vision.bodies.body_filter import BodyFilter
from systems.vision.bodies.feature_history import FeatureHistory, no_history


@dataclass(kw_only=True)
class RigidBodyMotionConfig:
    """How bodies are found, followed and given up."""

    period: float = 1.0 / 15.0  # Update period, [s].
    window: int = 30  # Ticks of each feature's history, [ticks].
    memory: int = 45  # An unseen feature is forgotten after so many, [ticks].
    rest_samples: float = 60.0  # Samples that average at most into a feature's rest.
    newest: int = 3  # Ticks that make a feature's newest position, [ticks].
    feature_floor: float = 2e-4  # Added to a feature's standard deviation, [m].
    landmark_floor: float = 3e-4  # Error of a landmark that averaging does not remove, [m].
    reset_floor: float = 1e-3  # The same for features that a body has when it comes into view, [m].
    reset_support: int = 8  # So many it needs then.
    landmark_walk: float = 5e-5  # Drift of a landmark, [m/sqrt(s)].
    turn_walk: float = 3e-4  # The same per turn of its body, [m/sqrt(rad)].
    angular_process_noise: float = 1e-2  # Spectral density, [rad^2/s^3].
    linear_process_noise: float = 2.5e-3  # Spectral density, [m^2/s^3].
    initial_angular_velocity: float = 0.1  # Standard deviation at the reference, [rad/s].
    initial_linear_velocity: float = 0.02  # Standard deviation at the reference, [m/s].
    gate: float = 16.27  # Squared Mahalanobis distance of 3 dof that 0.1 % exceed.
    moving: float = 20.0  # The same beyond which a feature does not stand still.
    nudged: float = 7.81  # The same beyond which it moved while the hand closed (5 %).
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
    max_landmarks: int = 50  # Features that a body's filter holds.
    max_rejections: int = 8  # Disagreements with its body after which a feature leaves it, [ticks].
    max_free_rejections: int = 45  # The same after which a free or left one is reset, [ticks].
    rotation_sigma: float = 0.1  # Prior rotation of a new body's first motion, [rad].
    jump_rotation: float = 0.1  # Unpredicted turn that is believed if features agree, [rad].
    jump_translation: float = 0.03  # The same for a shift, [m].
    prior_rotation_walk: float = 0.05  # Of the prior while no feature is seen, [rad/sqrt(s)].
    prior_translation_walk: float = 0.01  # The same, [m/sqrt(s)].
    blind_rotation: float = 0.1  # Of the held body unseen: beyond, no one feature joins it, [rad].
    blind_translation: float = 0.01  # The same, [m].
    handle_way: float = 2.5e-3  # How well the hand knows the handle's way over the window, [m].
    handle_noise: float = 1e-3  # Of a feature's displacement over the window, at least, [m].
    identification_travel: float = 0.003  # Way of the hand before a body can be held, [m].
    identification_miss: float = 0.5  # Share of that way a held body may miss, [-].
    seed: int = 0  # Of RANSAC.


@dataclass(kw_only=True)
class RestPositions:
    """Where features were before a body moved: ids (K,), p_WF (K, 3), covariance (K, 3, 3)."""

    ids: Ids
    p_WF: Array
    covariance: Array


@dataclass(kw_only=True)
class TrackedBody(Immutable):
    """One body's filter and recent past; never written after it is made.

    Attributes:
        body_id: Its number.
        filter: Belief about pose, velocity and landmarks.
        X_WB_reference: Pose (4, 4) at the reference.
        reference_tick: The last tick at which it is known to have stood there.
        rest: Positions until then of all features that existed, whosoever they are.
        path: X_WB over the window (H, 4, 4), newest last.
        support: Features that agreed with it at this tick.
        supported: Ticks with at least `keep_support`.
        unsupported: Ticks since then.
        source: Which prediction fitted best at this tick.
        held_since: Tick at which the hand had closed, of the interacted body; -1 for others.
        reset_count: How many times it was lost and its landmarks were placed anew.
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
    reset_count: int = 0


@dataclass(kw_only=True)
class BodyLevel(Immutable):
    """Everything the body level remembers."""

    tick: int
    next_id: int
    history: FeatureHistory
    bodies: list[TrackedBody] = field(default_factory=list)


def no_bodies(config: RigidBodyMotionConfig) -> BodyLevel:
    return BodyLevel(tick=-1, next_id=2, history=no_history(config.window))
