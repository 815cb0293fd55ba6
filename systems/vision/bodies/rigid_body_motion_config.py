"""How rigid bodies are found, followed and given up."""

from dataclasses import dataclass, field

import numpy as np

from maths.arrays import Array
from maths.gaussian import chi_square_gate
from maths.validation import require_fields, require_ranges
from systems.ticks import require_ticks, whole_ticks


@dataclass(kw_only=True)
class FeatureHistoryConfig:
    """What is remembered of each feature."""

    window: float = 2.0  # Length of a feature's history, [s].
    newest: float = 0.2  # Length of its end that makes the newest position, [s].
    memory: float = 3.0  # Time after which an unseen feature is forgotten, [s].
    rest_time: float = 4.0  # Longest time that is averaged into a feature's rest, [s].
    nudge_time: float = 1.0 / 3.0  # Time before a reference whose mean position shows a nudge, [s].
    floor: float = 2e-4  # Error added to a feature's standard deviation, [m].


@dataclass(kw_only=True)
class LandmarkConfig:
    """The constant positions of features in a body."""

    max_count: int = 50  # Most landmarks that a body's filter holds.
    floor: float = 3e-4  # Error of a landmark that averaging does not remove, [m].
    reset_floor: float = 1e-3  # The same where a body that was lost gets new landmarks, [m].
    reset_support: int = 8  # Least number of features that a lost body gets as landmarks.
    walk: float = 5e-5  # Drift of a landmark, a random walk, [m/sqrt(s)].
    turn_walk: float = 3e-4  # The same per turn of its body, [m/sqrt(rad)].


@dataclass(kw_only=True)
class BodyDynamicsConfig:
    """How a body moves."""

    angular_process_noise: float = 1e-2  # Spectral density of the acceleration, [rad^2/s^3].
    linear_process_noise: float = 2.5e-3  # The same for the translation, [m^2/s^3].
    initial_angular_velocity: float = 0.1  # Standard deviation at the reference, [rad/s].
    initial_linear_velocity: float = 0.02  # The same for the translation, [m/s].
    jump_rotation: float = 0.1  # Unpredicted turn that is believed if features agree, [rad].
    jump_translation: float = 0.03  # The same for a shift, [m].

    @property
    def process_noise(self) -> Array:
        """Spectral densities (6,) of the acceleration, [rad^2/s^3, m^2/s^3]."""
        return np.repeat([self.angular_process_noise, self.linear_process_noise], 3)

    @property
    def initial_velocity(self) -> Array:
        """Standard deviations (6,) of the velocity at the reference, [rad/s, m/s]."""
        return np.repeat([self.initial_angular_velocity, self.initial_linear_velocity], 3)

    @property
    def jump(self) -> Array:
        """Standard deviations (6,) of an unpredicted displacement, [rad, m]."""
        return np.repeat([self.jump_rotation, self.jump_translation], 3)


@dataclass(kw_only=True)
class BodyBirthConfig:
    """What free features have to show to make a new body."""

    motion_gate: float = 20.0  # Squared distance, 3 dof, beyond which a feature is moving, [-].
    support_gate: float = 9.0  # Least reduction of a feature's squared distance by a motion, [-].
    min_support: int = 6  # Least number of features.
    min_gain: float = 120.0  # Least sum of these reductions, [-].
    min_spread: float = 0.015  # Least root mean square distance from their centroid, [m].
    neighbourhood: float = 0.08  # Radius within which they have to outnumber all others, [m].
    rotation_sigma: float = 0.1  # Prior rotation of the first motion, 1 sigma, [rad].
    seed: int = 0  # Seed of RANSAC.


@dataclass(kw_only=True)
class AssociationConfig:
    """Which features belong to which body."""

    log_ratio: float = 8.0  # Log likelihood ratio that assigns or releases a feature, [nat].
    extent: float = 0.05  # Distance to a body's features that counts as one deviation, [m].
    max_penalty: float = 30.0  # Log likelihood ratio that distance costs at most, [nat].
    merging_share: float = 0.8  # Share of a body's features that makes it part of an older one.
    rejection_time: float = 8.0 / 15.0  # Time after which a rejected feature leaves its body, [s].
    free_rejection_time: float = 3.0  # Time after which a rejected free feature is reset, [s].


@dataclass(kw_only=True)
class HeldBodyConfig:
    """What the hand says about the body that it holds."""

    # Squared distance beyond which the closing hand has moved a feature, [-].
    nudge_gate: float = chi_square_gate(0.05, 3)
    prior_rotation_walk: float = 0.05  # Error of the prior while unseen, [rad/sqrt(s)].
    prior_translation_walk: float = 0.01  # The same for the translation, [m/sqrt(s)].
    blind_rotation: float = 0.1  # Error beyond which no single feature joins, [rad].
    blind_translation: float = 0.01  # The same for the translation, [m].
    handle_error: float = 2.5e-3  # Error of the handle's way over the window, [m].
    handle_noise: float = 1e-3  # Least error of a feature's way over the window, [m].
    identification_way: float = 0.003  # Least way of the hand that identifies a body, [m].
    identification_share: float = 0.5  # Largest share of it that the body may have missed, [-].

    @property
    def prior_walk(self) -> Array:
        """Random walk (6,) of the prior's error, [rad/sqrt(s), m/sqrt(s)]."""
        return np.repeat([self.prior_rotation_walk, self.prior_translation_walk], 3)


@dataclass(kw_only=True)
class RigidBodyMotionConfig:
    """How bodies are tracked; squared distances are squares of Mahalanobis distances."""

    period: float = 1.0 / 15.0  # Update period, [s].
    gate: float = chi_square_gate(0.001, 3)  # Least squared distance of an outlier, 3 dof, [-].
    keep_support: int = 3  # Least number of features that keeps a body alive.
    patience: float = 2.0  # Longest time that a body lives without them, [s].
    initial_patience: float = 1.0 / 3.0  # The same at birth; grows with the time it had them, [s].
    history: FeatureHistoryConfig = field(default_factory=FeatureHistoryConfig)
    landmarks: LandmarkConfig = field(default_factory=LandmarkConfig)
    dynamics: BodyDynamicsConfig = field(default_factory=BodyDynamicsConfig)
    birth: BodyBirthConfig = field(default_factory=BodyBirthConfig)
    association: AssociationConfig = field(default_factory=AssociationConfig)
    held_body: HeldBodyConfig = field(default_factory=HeldBodyConfig)


def check_rigid_body_motion(config: RigidBodyMotionConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    name = "RigidBodyMotion"
    require_ranges(
        name,
        config,
        positive="period gate",
        not_negative="patience initial_patience",
        counts="keep_support",
    )
    history = config.history
    require_ranges(f"{name}.history", history, not_negative="floor memory")
    require_ticks(f"{name}.history", history, config.period, lasting="rest_time")
    require_ticks(f"{name}.history", history, config.period, lasting="newest nudge_time", least=2)
    least = whole_ticks(history.newest, config.period) + 8
    require_ticks(f"{name}.history", history, config.period, lasting="window", least=least)
    landmarks = config.landmarks
    require_ranges(
        f"{name}.landmarks",
        landmarks,
        not_negative="floor reset_floor walk turn_walk",
        counts="reset_support",
    )
    require_fields(f"{name}.landmarks", landmarks, ["max_count"], ">= 3", lambda x: x >= 3)
    require_ranges(
        f"{name}.dynamics",
        config.dynamics,
        positive="angular_process_noise linear_process_noise initial_angular_velocity"
        " initial_linear_velocity jump_rotation jump_translation",
    )
    require_ranges(
        f"{name}.birth",
        config.birth,
        positive="motion_gate support_gate neighbourhood rotation_sigma",
        not_negative="min_gain min_spread seed",
        counts="min_support",
    )
    require_ranges(
        f"{name}.association",
        config.association,
        positive="log_ratio extent",
        not_negative="max_penalty",
        shares="merging_share",
    )
    require_ticks(
        f"{name}.association",
        config.association,
        config.period,
        lasting="rejection_time free_rejection_time",
    )
    require_ranges(
        f"{name}.held_body",
        config.held_body,
        positive="nudge_gate prior_rotation_walk prior_translation_walk blind_rotation"
        " blind_translation handle_error handle_noise",
        not_negative="identification_way",
        shares="identification_share",
    )
