"""What is known of an axis' distance before anything is measured, compiled.

Most hinges are within reach of the body that they hold, a gate's is farther away, and a path that
is nearly straight may belong to a hinge at any distance. The prior of the axis' place is an equal
mixture of normal distributions about the body, one a scale, so that a far axis is not pulled near
and a straight path does not send it to infinity.
"""

import numpy as np

from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes

_FARTHER = (1.0, 4.0, 16.0)  # Multiples of the nearest scale.
_WELL_SEEN = 0.1**2  # Variance of a measured rotation, [rad^2].


@hot
def may_be_far(kf: Keyframes) -> bool:
    """Whether rotations are measured well enough to tell a far hinge from a bent slide."""
    R = kf.R[kf.size[0] - 1]
    return bool(max(R[0, 0], R[1, 1], R[2, 2]) < _WELL_SEEN)


@hot
def axis_prior(square: float, sigma: float, far: bool) -> tuple[float, float]:
    """Log density of an axis' place and its information per direction, linearised there.

    Without the constant of all normal densities.

    Args:
        square: Of the distance, [m^2].
        sigma: The nearest scale, standard deviation per direction, [m].
        far: Whether the axis may be farther away than that.
    """
    if not far:
        return -0.5 * square / sigma**2 - 2.0 * np.log(sigma), 1.0 / sigma**2
    total, information = 0.0, 0.0
    # Relative to this, no density is above one, and the widest is not zero.
    widest = sigma * _FARTHER[-1]
    top = -0.5 * square / widest**2 - 2.0 * np.log(sigma)
    for factor in _FARTHER:
        s = sigma * factor
        density = np.exp(-0.5 * square / s**2 - 2.0 * np.log(s) - top)
        total += density
        information += density / s**2
    return top + np.log(total / len(_FARTHER)), information / total
