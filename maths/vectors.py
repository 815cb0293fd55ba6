"""Vectors of three dimensions, compiled; NumPy's take twenty times as long for a single one."""

import numba
import numpy as np

from crossmodal.maths.arrays import Array


@numba.njit(cache=True)
def cross(a: Array, b: Array) -> Array:
    """a x b (3,)."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@numba.njit(cache=True)
def tangent_basis(axis: Array) -> Array:
    """Two unit vectors (3, 2) perpendicular to `axis` and to each other."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(axis))] = 1.0
    U = np.empty((3, 2))
    U[:, 0] = cross(axis, helper)
    U[:, 0] /= np.sqrt(np.sum(U[:, 0] ** 2))
    U[:, 1] = cross(axis, U[:, 0])
    return U
