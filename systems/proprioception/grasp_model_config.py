"""How a grasp is believed to hold and to give way."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, numbers, require
from crossmodal.systems.proprioception.grasp_failure import GraspFailureConfig
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class GraspModelConfig(Ticked):
    # Probability when the hand closes, if it holds the body.
    prior_perfect: float = number(0.72, above=0.0, at_most=1.0)
    prior_revolute: float = number(0.21, above=0.0, at_most=1.0)  # The same of a revolute grasp.
    # The same of a cylindrical grasp.
    prior_cylindrical: float = number(0.07, above=0.0, at_most=1.0)
    # Direction of the bar, about which the fingers curl.
    axis_H: np.ndarray = numbers(np.array([0.0, 1.0, 0.0]), at_least=-10.0, at_most=10.0)
    # Point on the bar.
    p_HA: np.ndarray = numbers(np.array([0.0, 0.0, -0.02]), at_least=-10.0, at_most=10.0, unit="m")
    # Standard deviation of the bar's direction.
    axis_deviation: float = number(0.2, at_least=1e-9, at_most=10.0, unit="rad")
    # Standard deviation of the bar's place.
    point_deviation: float = number(0.015, at_least=1e-9, at_most=10.0, unit="m")
    # Random walk of the body about the bar.
    rotation_process_noise: float = number(0.05, at_least=1e-9, at_most=10.0, unit="rad/s^0.5")
    # Random walk of the body along the bar.
    sliding_process_noise: float = number(0.02, at_least=1e-9, at_most=10.0, unit="m/s^0.5")
    # Random walk of the axis in the soft palm.
    axis_process_noise: float = number(0.01, at_least=1e-9, at_most=10.0, unit="rad/s^0.5")
    # Random walk of the point on it.
    point_process_noise: float = number(3.0e-3, at_least=1e-9, at_most=10.0, unit="m/s^0.5")
    # Of the bent hand's error, a Gauss-Markov process.
    hand_correlation_time: float = number(30.0, at_least=1e-3, at_most=1e5, unit="s")
    # Slip, a random walk over the hand's way.
    slip_rotation: float = number(0.03, at_least=0.0, at_most=100.0, unit="rad/m^0.5")
    # The same for the translation.
    slip_translation: float = number(2.0e-3, at_least=0.0, at_most=10.0, unit="m/m^0.5")
    # Time constant with which the evidence fades.
    memory: float = number(0.7, at_least=1e-3, at_most=1e5, unit="s")
    # Probability that a loose grasp has become firm.
    lodging: float = number(0.1, at_least=0.0, below=1.0)
    # Most that one tick speaks against a type.
    loss_limit: float = number(10.0, above=0.0, at_most=1000.0, unit="nat")
    # Squared innovation above which a filter is not corrected.
    gate: float = number(30.0, above=0.0, at_most=1e6)
    # Time of rejections after which a filter is started again.
    patience: float = number(1.0, above=0.0, at_most=3600.0, unit="s")
    failure: GraspFailureConfig = field(default_factory=GraspFailureConfig)


def morphology(config: GraspModelConfig) -> tuple[Array, Array]:
    """The hand's grasping axis (3,), a unit vector in H, and a point on it (3,)."""
    axis = np.asarray(config.axis_H, dtype=float)
    return axis / np.linalg.norm(axis), np.asarray(config.p_HA, dtype=float)


def prior_probabilities(config: GraspModelConfig) -> Array:
    """Of the types (4,), in the order of `TYPES`."""
    failed = config.failure.prior
    held = [config.prior_perfect, config.prior_revolute, config.prior_cylindrical]
    return np.append((1.0 - failed) * np.array(held), failed)


def check_grasp_model(config: GraspModelConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    check(config, "GraspModel")
    length = float(np.linalg.norm(config.axis_H))
    require(length > 1e-6, "GraspModel", config, "axis_H", "a direction")
    total = float(prior_probabilities(config).sum())
    require(abs(total - 1.0) < 1e-6, "GraspModel", config, "prior_perfect", "a sum of one")
