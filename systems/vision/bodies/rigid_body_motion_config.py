"""How rigid bodies are found, followed and given up."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import outlier_gate
from crossmodal.maths.validation import check, number
from crossmodal.systems.ticks import Ticked, require_ticks, whole_ticks

GATE = outlier_gate(3)  # Squared distance from which on a feature is an outlier.


@dataclass(kw_only=True)
class FeatureHistoryConfig:
    """What is remembered of each feature."""

    # Length of a feature's history.
    window: float = number(2.0, at_least=1e-3, at_most=60.0, unit="s")
    # Length of the history's end over which the newest position is averaged.
    newest: float = number(0.2, at_least=1e-3, at_most=60.0, unit="s")
    # Time after which an unseen feature is forgotten.
    memory: float = number(3.0, at_least=0.0, at_most=3600.0, unit="s")
    # Longest time that is averaged into a feature's rest.
    rest_time: float = number(4.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Time before a reference whose mean position shows a nudge.
    nudge_time: float = number(1.0 / 3.0, at_least=1e-3, at_most=60.0, unit="s")
    # Error added to a feature's standard deviation.
    floor: float = number(2e-4, at_least=0.0, at_most=1.0, unit="m")


@dataclass(kw_only=True)
class LandmarkConfig:
    """The constant positions of features in a body."""

    # Most landmarks that a body's filter holds.
    max_count: int = number(50, at_least=3, at_most=1000)
    # Error of a landmark that averaging does not remove.
    floor: float = number(3e-4, at_least=0.0, at_most=1.0, unit="m")
    # The same where a body that was lost gets new landmarks.
    reset_floor: float = number(1e-3, at_least=0.0, at_most=1.0, unit="m")
    # Least number of features that a lost body gets as landmarks.
    reset_support: int = number(8, at_least=1, at_most=10000)
    # Drift of a landmark, a random walk.
    walk: float = number(5e-5, at_least=0.0, at_most=1.0, unit="m/s^0.5")
    # The same per turn of its body.
    turn_walk: float = number(3e-4, at_least=0.0, at_most=1.0, unit="m/rad^0.5")


@dataclass(kw_only=True)
class BodyDynamicsConfig:
    """How a body moves."""

    # Spectral density of the acceleration.
    angular_process_noise: float = number(1e-2, at_least=1e-12, at_most=1000.0, unit="rad^2/s^3")
    # The same for the translation.
    linear_process_noise: float = number(2.5e-3, at_least=1e-12, at_most=1000.0, unit="m^2/s^3")
    # Standard deviation at the reference.
    initial_velocity: float = number(0.02, at_least=1e-9, at_most=100.0, unit="m/s")
    # Unpredicted turn that is believed if features agree.
    jump_rotation: float = number(0.1, at_least=1e-9, at_most=10.0, unit="rad")
    # The same for a shift.
    jump_translation: float = number(0.03, at_least=1e-9, at_most=10.0, unit="m")

    @property
    def process_noise(self) -> Array:
        """Spectral densities (6,) of the acceleration, [rad^2/s^3, m^2/s^3]."""
        return np.repeat([self.angular_process_noise, self.linear_process_noise], 3)

    @property
    def jump(self) -> Array:
        """Standard deviations (6,) of an unpredicted displacement, [rad, m]."""
        return np.repeat([self.jump_rotation, self.jump_translation], 3)


@dataclass(kw_only=True)
class BodyInitiationConfig:
    """What free features have to show to make a new body."""

    # Squared distance, 3 dof, beyond which a feature is moving.
    motion_gate: float = number(20.0, above=0.0, at_most=1e6)
    # Least reduction of a feature's squared distance by a motion.
    support_gate: float = number(9.0, above=0.0, at_most=1e6)
    min_support: int = number(6, at_least=1, at_most=10000)  # Least number of features.
    min_gain: float = number(120.0, at_least=0.0, at_most=1e9)  # Least sum of these reductions.
    # Least root mean square distance from their centroid.
    min_spread: float = number(0.015, at_least=0.0, at_most=10.0, unit="m")
    # Radius within which they have to outnumber all other features.
    neighbourhood: float = number(0.08, above=0.0, at_most=100.0, unit="m")
    # Prior rotation of the first motion, 1 sigma.
    rotation_sigma: float = number(0.1, at_least=1e-9, at_most=10.0, unit="rad")


@dataclass(kw_only=True)
class AssociationConfig:
    """Which features belong to which body."""

    # Log likelihood ratio that assigns or releases a feature.
    log_ratio: float = number(8.0, above=0.0, at_most=1e4, unit="nat")
    # Distance to a body's features that counts as one standard deviation.
    extent: float = number(0.05, at_least=1e-6, at_most=100.0, unit="m")
    # Log likelihood ratio that distance costs at most.
    max_penalty: float = number(30.0, at_least=0.0, at_most=1e4, unit="nat")
    # Share of a body's features that makes it part of an older one.
    merging_share: float = number(0.8, above=0.0, at_most=1.0)
    # Time after which a rejected feature leaves its body.
    rejection_time: float = number(8.0 / 15.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Time after which a rejected free feature is reset.
    free_rejection_time: float = number(3.0, at_least=1e-3, at_most=3600.0, unit="s")


@dataclass(kw_only=True)
class HeldBodyConfig:
    """What the hand says about the body that it holds."""

    # Error of the prior while unseen.
    prior_walk: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m/s^0.5")
    # Error beyond which no single feature joins.
    blind_rotation: float = number(0.1, above=0.0, at_most=10.0, unit="rad")
    # The same for the translation.
    blind_translation: float = number(0.01, above=0.0, at_most=10.0, unit="m")
    # Error of the handle's displacement over the window.
    handle_error: float = number(2.5e-3, at_least=1e-9, at_most=1.0, unit="m")
    # Least error of a feature's displacement over the window.
    handle_noise: float = number(1e-3, at_least=1e-9, at_most=1.0, unit="m")
    # Least displacement of the hand that identifies a body.
    identification_displacement: float = number(0.003, at_least=0.0, at_most=10.0, unit="m")
    # Largest share of this displacement that the body may have missed.
    identification_share: float = number(0.5, above=0.0, at_most=1.0)


@dataclass(kw_only=True)
class RigidBodyMotionConfig(Ticked):
    """How bodies are tracked; squared distances are squares of Mahalanobis distances."""

    # Least number of features that keeps a body alive.
    keep_support: int = number(3, at_least=1, at_most=10000)
    # Longest time that a body lives without them.
    patience: float = number(2.0, at_least=0.0, at_most=3600.0, unit="s")
    # The same when its track begins; it grows with the time for which it had them.
    initial_patience: float = number(1.0 / 3.0, at_least=0.0, at_most=3600.0, unit="s")
    history: FeatureHistoryConfig = field(default_factory=FeatureHistoryConfig)
    landmarks: LandmarkConfig = field(default_factory=LandmarkConfig)
    dynamics: BodyDynamicsConfig = field(default_factory=BodyDynamicsConfig)
    initiation: BodyInitiationConfig = field(default_factory=BodyInitiationConfig)
    association: AssociationConfig = field(default_factory=AssociationConfig)
    held_body: HeldBodyConfig = field(default_factory=HeldBodyConfig)


def check_rigid_body_motion(config: RigidBodyMotionConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    name, period = "RigidBodyMotion", config.period
    check(config, name)
    require_ticks(name, config, period, lasting="history.rest_time")
    require_ticks(name, config, period, lasting="history.newest history.nudge_time", least=2)
    least = whole_ticks(config.history.newest, period) + 8
    require_ticks(name, config, period, lasting="history.window", least=least)
    rejection = "association.rejection_time association.free_rejection_time"
    require_ticks(name, config, period, lasting=rejection)
