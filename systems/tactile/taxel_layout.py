"""Where the taxels lie on a tactile fingertip, and how its skin gives way."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

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


# Semi-axes (3,) of the fingertip's surface along the axes of S, [m].
SEMI_AXES = np.array([0.010, 0.010, 0.015])
# x and z of each taxel of the pad (12, 2), in S, [m].
PAD_PLACES = 1e-3 * np.array(
    [
        [-3.0, -3.5],
        [-3.0, -9.0],
        [3.0, -9.0],
        [3.0, -3.5],
        [-7.5, -3.5],
        [7.5, -3.5],
        [-7.5, 3.5],
        [7.5, 3.5],
        [-3.0, 3.5],
        [-3.0, 9.0],
        [3.0, 9.0],
        [3.0, 3.5],
    ]
)
_FEWEST = 4


@dataclass(frozen=True, kw_only=True)
class TaxelLayout(Immutable):
    """The taxels of an ellipsoidal fingertip, in its frame S.

    The origin of S is the ellipsoid's centre, y points out of the pad, z along the finger.

    Attributes:
        p_ST: Places (T, 3) on the surface, [m].
        n_S: Outward unit normals (T, 3) of the surface there.
        semi_axes: Of the ellipsoid (3,), along the axes of S, [m].
    """

    p_ST: Array
    n_S: Array
    semi_axes: Array

    def __post_init__(self) -> None:
        if len(self.p_ST) < _FEWEST:
            raise ValueError(
                f"TaxelLayout: {len(self.p_ST)} taxels, need at least {_FEWEST} to tell where a"
                " contact is"
            )


def fingertip_layout() -> TaxelLayout:
    """The layout of the fingertip in models/sdf: taxels 0, 3, 8 and 11 are around the centre."""
    return pad_layout(PAD_PLACES)


def pad_layout(places: Array, semi_axes: Array = SEMI_AXES) -> TaxelLayout:
    """Taxels on the half y > 0 of an ellipsoid.

    Args:
        places: x and z of each (T, 2), in S, [m].
        semi_axes: Of the ellipsoid (3,), [m].

    Raises:
        ValueError: if there are fewer than four, or a place is beside the pad.
    """
    a, b, c = semi_axes
    x, z = places.T
    rest = 1.0 - (x / a) ** 2 - (z / c) ** 2
    if not np.all(rest > 0.0):
        index = int(np.argmin(rest > 0.0))
        raise ValueError(
            f"TaxelLayout: taxel {index} at {places[index].tolist()} m is not on the pad"
        )
    p_ST = np.column_stack([x, b * np.sqrt(rest), z])
    return TaxelLayout(p_ST=p_ST, n_S=surface_normals(p_ST, semi_axes), semi_axes=semi_axes)


def surface_normals(p_SQ: Array, semi_axes: Array = SEMI_AXES) -> Array:
    """Outward unit normals (N, 3) of an ellipsoid at points (N, 3) of its surface."""
    gradient = p_SQ / semi_axes**2
    return np.asarray(gradient / np.linalg.norm(gradient, axis=-1, keepdims=True))
