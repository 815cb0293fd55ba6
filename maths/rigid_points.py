"""Points of a rigid body: how they move with its pose."""

import numpy as np

from crossmodal.maths.arrays import Array

_TURN = 5.0  # A body that shifts by a metre turns by so much, both 1 sigma, [rad/m].


def pose_scale(translation: float) -> Array:
    """Standard deviations (6,) of a pose, rotation first, from that of its translation.

    Turning counts like shifting at a radius of .2 m, where the features of a held body lie.
    """
    return np.repeat([_TURN * translation, translation], 3)


def pose_jacobian(p: Array) -> Array:
    """d(exp(xi) p)/dxi (K, 3, 6) at zero, for points (K, 3)."""
    J = np.zeros((len(p), 3, 6))
    J[:, 0, 1], J[:, 0, 2], J[:, 1, 2] = p[:, 2], -p[:, 1], p[:, 0]
    J[:, 1, 0], J[:, 2, 0], J[:, 2, 1] = -p[:, 2], p[:, 1], -p[:, 0]
    J[:, [0, 1, 2], [3, 4, 5]] = 1.0
    return J
