"""How a grasp is believed to hold and to give way."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, require
from crossmodal.systems.proprioception.grasp_failure import GraspFailureConfig
from crossmodal.systems.proprioception.hand_config import HandConfig, check_hand
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class GraspModelConfig(Ticked):
    # Probability of a firm grasp when the hand closes, if it holds the body; what this and
    # `prior_revolute` leave is a cylindrical grasp's.
    prior_perfect: float = number(0.72, above=0.0, below=1.0)
    # Probability of a grasp about which the body turns, if the hand holds it.
    prior_revolute: float = number(0.21, above=0.0, below=1.0)
    hand = HandConfig()
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
    # Time constant with which the evidence fades.
    memory: float = number(0.7, at_least=1e-3, at_most=1e5, unit="s")
    # Probability that a loose grasp has become firm.
    lodging: float = number(0.1, at_least=0.0, below=1.0)
    # Largest loss of log evidence of a type at one tick.
    loss_limit: float = number(10.0, above=0.0, at_most=1000.0, unit="nat")
    # Squared innovation above which a filter is not corrected.
    gate: float = number(30.0, above=0.0, at_most=1e6)
    # Time of rejections after which a filter is started again.
    patience: float = number(1.0, above=0.0, at_most=3600.0, unit="s")
    failure: GraspFailureConfig = field(default_factory=GraspFailureConfig)


def prior_probabilities(config: GraspModelConfig) -> Array:
    """Of the types (4,), in the order of `TYPES`."""
    failed = config.failure.prior
    loose = [config.prior_revolute, 1.0 - config.prior_perfect - config.prior_revolute]
    held = [config.prior_perfect, *loose]
    return np.append((1.0 - failed) * np.array(held), failed)


def check_grasp_model(config: GraspModelConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    check(config, "GraspModel")
    check_hand(config.hand, "GraspModel")
    least = 1.0 - config.prior_perfect - config.prior_revolute
    require(least > 0.0, "GraspModel", config, "prior_perfect", "a sum below one")
