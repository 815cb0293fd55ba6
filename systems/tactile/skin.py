"""How deep the skin of a tactile fingertip is pressed in."""

import numpy as np

from crossmodal.maths.arrays import Array

_POISSON = 0.5  # Of silicone, which keeps its volume.


def indentation(force: float, modulus: float, semi_axes: Array) -> float:
    """Depth to which a flat thing presses an ellipsoidal skin at its pole, [m].

    Hertz's contact of an elastic sphere, with the mean of the ellipsoid's two radii of curvature.

    Args:
        force: Normal to the skin, [N].
        modulus: Young's, of the skin, [Pa].
        semi_axes: (3,), y out of the pad, [m].

    Source: K. L. Johnson, Contact Mechanics, 1985, equation 4.23.
    """
    a, b, c = semi_axes
    radius = a * c / b
    plane_strain = modulus / (1.0 - _POISSON**2)
    return float(np.cbrt(9.0 * force**2 / (16.0 * radius * plane_strain**2)))
