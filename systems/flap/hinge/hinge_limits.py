"""What has to be known of a hinge before it is believed."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number


@dataclass(kw_only=True)
class HingeLimitsConfig:
    """Limits that every estimator of a hinge keeps to."""

    # Turn below which nothing is believed.
    least_turn: float = number(0.12, above=0.0, at_most=3.0, unit="rad")
    # Largest standard deviation of an axis that is believed.
    largest_direction: float = number(0.15, above=0.0, at_most=1.0, unit="rad")
    # Likewise of where it is.
    largest_distance: float = number(0.025, above=0.0, at_most=1.0, unit="m")


def is_believed(direction: Array, point: Array, limits: HingeLimitsConfig) -> bool:
    """Whether an axis is known well enough.

    Args:
        direction: Covariance (3, 3) of its direction, [rad^2]; NaN where there is none.
        point: Covariance (3, 3) of where it is, across it, [m^2].
    """
    if not (np.isfinite(direction).all() and np.isfinite(point).all()):
        return False
    return bool(
        np.linalg.eigvalsh(direction)[-1] < limits.largest_direction**2
        and np.linalg.eigvalsh(point)[-1] < limits.largest_distance**2
    )
