"""Vectors of three dimensions, compiled; NumPy's take twenty times as long for a single one."""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def cross(a: Array, b: Array) -> Array:
    """a x b (3,)."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@hot
def tangent_basis(axis: Array) -> Array:
    """Two unit vectors (3, 2) perpendicular to `axis` and to each other."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(axis))] = 1.0
    u, U = cross(axis, helper), np.empty((3, 2))
    u /= np.sqrt(np.sum(u**2))
    v = cross(axis, u)
    for i in range(3):
        U[i, 0], U[i, 1] = u[i], v[i]
    return U
