"""Whose calibrations displace what is known of the flap."""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import DisplacementBelief

CAMERA, FINGER, HOLDER = "camera", "finger", "holder"
NAMES = (CAMERA, HOLDER, FINGER)


def holder_given_others(belief: DisplacementBelief) -> tuple[Array, Array, Array]:
    """The holder's displacement by the camera's and the finger's x: m + G x, with a covariance.

    Returns:
        m (6,), G (6, 12) and the covariance (6, 6) of what they do not say.
    """
    mean, P = belief.of(CAMERA, FINGER, HOLDER)
    G = np.asarray(np.linalg.solve(P[:12, :12] + 1e-12 * np.eye(12), P[:12, 12:]).T, dtype=float)
    return mean[12:] - G @ mean[:12], G, P[12:, 12:] - G @ P[:12, 12:]
