"""The goodness of fit of the joint filters' likeliest type."""

import math

import scipy.special

from systems.kinematics.joint_solver.joint_fit import off_path
from systems.kinematics.joint_solver.joint_geometry import RIGID
from systems.kinematics.joint_solver.joint_models import Models
from systems.kinematics.joint_solver.noise_scale import NoiseScale, degrees_of_freedom
from systems.kinematics.joint_solver.pose_keyframes import Keyframes

_INSIDE = 0.95  # Probability of the bounds.


def reduced_chi_square(
    kind: int, m: Models, kf: Keyframes, noise: NoiseScale
) -> tuple[float, tuple[float, float], int]:
    """Reduced chi-square of the keyframes off a joint's path, its 95 % bounds, and its degrees.

    The noise's scale is an estimate too, so that the bounds are those of an F distribution. NaN for
    the free walk, which has no path to be off, and where there is too little data.
    """
    nothing = math.nan, (math.nan, math.nan), 0
    if kind > RIGID:
        return nothing
    square, degrees = off_path(kind, m, kf)
    if degrees < 1:
        return nothing
    of_noise, tail = degrees_of_freedom(noise), 0.5 - 0.5 * _INSIDE
    low, high = (float(scipy.special.fdtri(degrees, of_noise, p)) for p in (tail, 1.0 - tail))
    return square / degrees, (low, high), degrees
