"""How the held body is predicted by the hand and corrected by features."""

from dataclasses import dataclass

from maths.validation import require, require_positive


@dataclass(kw_only=True)
class HeldBodyMotionConfig:
    period: float = 1.0 / 15.0  # Update period, [s].
    hand_correlation_time: float = 30.0  # Of the bent hand's error, a Gauss-Markov process, [s].
    slip_rotation: float = 0.03  # Slip in the hand, a random walk over its way, [rad/m^0.5].
    slip_translation: float = 2.0e-3  # The same for the translation, [m/m^0.5].
    reference_rotation_error: float = 0.05  # Settling of the grip after the reference, [rad].
    reference_translation_error: float = 6.0e-3  # The same for the translation, [m].
    reset_rotation_error: float = 0.015  # The same after new landmarks were placed, [rad].
    reset_translation_error: float = 3.0e-3  # The same for the translation, [m].
    reference_error_time: float = 2.0  # Time constant with which these errors decay, [s].
    lever: float = 0.1  # Way that a turn of the hand counts as, [m/rad].
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


def check_held_body_motion(config: HeldBodyMotionConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    units = {
        "period": "s",
        "hand_correlation_time": "s",
        "reference_rotation_error": "rad",
        "reference_translation_error": "m",
        "reference_error_time": "s",
        "reset_rotation_error": "rad",
        "reset_translation_error": "m",
        "lever": "m/rad",
        "hinge_curvature": "rad/m",
        "rotation_velocity_noise": "rad/s",
        "translation_velocity_noise": "m/s",
        "landmark_rotation_floor": "rad",
        "landmark_translation_floor": "m",
        "jump_gate": "",
        "jump_rotation": "rad",
        "jump_translation": "m",
    }
    name = "HeldBodyMotion"
    require_positive(name, config, units)
    require(config.slip_rotation >= 0, name, config, "slip_rotation", ">= 0 rad/m^0.5")
    require(config.slip_translation >= 0, name, config, "slip_translation", ">= 0 m^0.5")
    require(config.minimum_features >= 3, name, config, "minimum_features", ">= 3")
    for share in ("inlier_share", "retained_share"):
        require(0 < getattr(config, share) <= 1, name, config, share, "in (0, 1]")
