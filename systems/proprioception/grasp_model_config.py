"""How a grasp is believed to hold and to give way."""

from dataclasses import dataclass, field

import numpy as np

from maths.arrays import Array
from maths.validation import require, require_positive, require_vector
from systems.proprioception.grasp_failure import GraspFailureConfig


@dataclass(kw_only=True)
class GraspModelConfig:
    period: float = 1.0 / 15.0  # Update period, [s].
    prior_perfect: float = 0.72  # Probability when the hand closes, if it holds the body, [-].
    prior_revolute: float = 0.21  # The same of a revolute grasp, [-].
    prior_cylindrical: float = 0.07  # The same of a cylindrical grasp, [-].
    # Direction of the bar, about which the fingers curl.
    axis_H: np.ndarray = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    # Point on the bar, [m].
    p_HA: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -0.02]))
    axis_deviation: float = 0.2  # Standard deviation of the bar's direction, [rad].
    point_deviation: float = 0.015  # Standard deviation of the bar's place, [m].
    rotation_process_noise: float = 0.05  # Random walk of the body about the bar, [rad/s^0.5].
    sliding_process_noise: float = 0.02  # Random walk of the body along the bar, [m/s^0.5].
    axis_process_noise: float = 0.01  # Random walk of the axis in the soft palm, [rad/s^0.5].
    point_process_noise: float = 3.0e-3  # Random walk of the point on it, [m/s^0.5].
    hand_correlation_time: float = 30.0  # Of the bent hand's error, a Gauss-Markov process, [s].
    slip_rotation: float = 0.03  # Slip, a random walk over the hand's way, [rad/m^0.5].
    slip_translation: float = 2.0e-3  # The same for the translation, [m/m^0.5].
    memory: float = 0.7  # Time constant with which the evidence fades, [s].
    lodging: float = 0.1  # Probability that a loose grasp has become firm, [-].
    loss_limit: float = 10.0  # Most that one tick speaks against a type, [nat].
    gate: float = 30.0  # Squared innovation above which a filter is not corrected, [-].
    patience: float = 1.0  # Time of rejections after which a filter is started again, [s].
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
    units = {
        "period": "s",
        "prior_perfect": "",
        "prior_revolute": "",
        "prior_cylindrical": "",
        "axis_deviation": "rad",
        "point_deviation": "m",
        "rotation_process_noise": "rad/s^0.5",
        "axis_process_noise": "rad/s^0.5",
        "point_process_noise": "m/s^0.5",
        "sliding_process_noise": "m/s^0.5",
        "hand_correlation_time": "s",
        "memory": "s",
        "loss_limit": "nat",
        "gate": "",
        "patience": "s",
    }
    require_positive("GraspModel", config, units)
    for name, unit in {"slip_rotation": "rad/m^0.5", "slip_translation": "m^0.5"}.items():
        require(getattr(config, name) >= 0, "GraspModel", config, name, f">= 0 {unit}")
    for name, unit in {"axis_H": "-", "p_HA": "m"}.items():
        require_vector("GraspModel", config, name, unit)
    length = float(np.linalg.norm(config.axis_H))
    require(length > 1e-6, "GraspModel", config, "axis_H", "a direction")
    require(0 <= config.lodging < 1, "GraspModel", config, "lodging", "in [0, 1)")
    units = {"prior": "", "way": "m", "rest": "m", "limit": "nat"}
    require_positive("GraspModel", config.failure, units)
    require(config.failure.prior < 1, "GraspModel", config.failure, "prior", "< 1")
    require(config.failure.shift >= 0, "GraspModel", config.failure, "shift", ">= 0")
    total = float(prior_probabilities(config).sum())
    require(abs(total - 1.0) < 1e-6, "GraspModel", config, "prior_perfect", "a sum of one")
