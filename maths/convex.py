"""Convex hulls: on which of its facets an object stands."""

import numpy as np
from scipy.spatial import ConvexHull

from crossmodal.maths.arrays import Array

_SAME_FACET = 1e-3  # Sine of the angle up to which two triangles of a hull are of one facet.
_ROUNDING = 1e-9  # Of an angle, [rad].
_AT_ONCE = 64  # Facets, which bounds the memory for hulls of many.


def steady_directions(hull: ConvexHull, p_OCm: Array, tilt: float = 0.0) -> Array:
    """Directions (S, 3) in O that point up while an object stands on a facet of its convex hull.

    A facet of several triangles has its direction several times.

    Args:
        hull: Of the object, in O, [m].
        p_OCm: Its centre of mass (3,), [m].
        tilt: It returns to the facet when it is tilted by this angle about any edge, [rad].
    """
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    heights = -(normals @ p_OCm + offsets)
    steady = np.empty(len(normals), bool)
    for some in np.array_split(np.arange(len(normals)), len(normals) // _AT_ONCE + 1):
        feet = p_OCm + heights[some, None] * normals[some]
        sines = np.sqrt(np.maximum(1.0 - (normals[some] @ normals.T) ** 2, 0.0))
        inside = -(feet @ normals.T + offsets)
        to_edges = np.divide(
            inside, sines, out=np.full_like(inside, np.inf), where=sines > _SAME_FACET
        )
        steady[some] = np.arctan2(to_edges.min(axis=1), heights[some]) >= tilt - _ROUNDING
    return np.ascontiguousarray(-normals[steady])
