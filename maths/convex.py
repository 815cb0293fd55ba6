"""Convex hulls: on which of its facets an object stands."""

import numpy as np
from scipy.spatial import ConvexHull

from crossmodal.maths.arrays import Array

_SAME_FACET = 1e-3  # Sine of the angle up to which two triangles of a hull are of one facet.
_ROUNDING = 1e-9  # Of an angle, [rad].


def steady_directions(hull: ConvexHull, p_OCm: Array, tilt: float = 0.0) -> Array:
    """Directions (S, 3) in O that point up while an object stands on a facet of its convex hull.

    A facet of several triangles has its direction several times.

    Args:
        hull: Of the object, in O, [m].
        p_OCm: Its centre of mass (3,), [m].
        tilt: It returns to the facet when it is tilted by this angle about any edge, [rad].
    """
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    found = []
    for n, offset in zip(normals, offsets, strict=True):
        height = -float(n @ p_OCm + offset)
        foot = p_OCm + height * n
        sines = np.linalg.norm(np.cross(normals, n), axis=1)
        others = sines > _SAME_FACET
        to_edges = -(normals[others] @ foot + offsets[others]) / sines[others]
        if np.arctan2(to_edges.min(), height) >= tilt - _ROUNDING:
            found.append(-n)
    return np.array(found).reshape(-1, 3)
