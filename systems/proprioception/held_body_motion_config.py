"""How the held body is predicted by the hand and corrected by features."""

from dataclasses import dataclass

from crossmodal.maths.validation import number
from crossmodal.systems.proprioception.hand_config import HandConfig
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class HeldBodyMotionConfig(Ticked):
    # White error of the end-effector above which no reference is taken.
    largest_error: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m")
    hand = HandConfig()
    # Settling of the grip after the reference.
    reference_rotation_error: float = number(0.05, at_least=1e-9, at_most=10.0, unit="rad")
    # The same for the translation.
    reference_translation_error: float = number(6.0e-3, at_least=1e-9, at_most=10.0, unit="m")
    # Time constant with which these errors decay.
    reference_error_time: float = number(2.0, at_least=1e-3, at_most=1e5, unit="s")
    # A turn of the hand counts as this displacement.
    lever: float = number(0.1, at_least=1e-6, at_most=100.0, unit="m/rad")
    # One over the radius of a hinge, 1 sigma.
    hinge_curvature: float = number(3.0, at_least=1e-6, at_most=1000.0, unit="rad/m")
    # Of the velocity, by slip and by the rate of bending.
    velocity_noise: float = number(4.0e-3, at_least=1e-9, at_most=100.0, unit="m/s")
    # Least number of features that tell a pose.
    minimum_features: int = number(8, at_least=3, at_most=10000)
    # Least share of them that agrees on one pose.
    inlier_share: float = number(0.5, above=0.0, at_most=1.0)
    # Common error of the landmarks.
    landmark_rotation_floor: float = number(2.0e-3, at_least=1e-9, at_most=1.0, unit="rad")
    # The same for the translation.
    landmark_translation_floor: float = number(3.0e-4, at_least=1e-9, at_most=1.0, unit="m")
    # Standard deviation of a slip that shows as an outlier.
    jump: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m")
    # Least share of features seen before that shows a slip.
    retained_share: float = number(0.5, above=0.0, at_most=1.0)
