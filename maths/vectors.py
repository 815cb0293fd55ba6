"""Vectors of three dimensions and the plane normal to one, compiled; NumPy is slower for one."""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def tangent_basis(a: Array, B: Array) -> None:
    """Writes two unit vectors normal to the unit vector `a` and to each other into `B` (2, 3)."""
    k = 0
    for i in range(1, 3):
        if abs(a[i]) < abs(a[k]):
            k = i
    s = np.sqrt(1.0 - a[k] * a[k])
    for i in range(3):
        B[0, i] = ((1.0 if i == k else 0.0) - a[k] * a[i]) / s
    B[1, 0] = a[1] * B[0, 2] - a[2] * B[0, 1]
    B[1, 1] = a[2] * B[0, 0] - a[0] * B[0, 2]
    B[1, 2] = a[0] * B[0, 1] - a[1] * B[0, 0]


@hot
def normal_basis(a: Array) -> Array:
    """Two unit vectors (2, 3) normal to the unit vector `a` and to each other."""
    B = np.empty((2, 3))
    tangent_basis(a, B)
    return B


@hot
def transport(a: Array, b: Array, Q: Array) -> None:
    """Writes how coordinates in the basis at `a` become those in the basis at `b` into `Q` (2, 2).

    The least rotation that turns the unit vector `a` into `b` takes tangent vectors with it, not
    the bases: where another component becomes the smallest, they turn at once.
    """
    A, B = np.empty((2, 3)), np.empty((2, 3))
    tangent_basis(a, A)
    tangent_basis(b, B)
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    for j in range(2):
        along = (A[j, 0] * b[0] + A[j, 1] * b[1] + A[j, 2] * b[2]) / (1.0 + cosine)
        for i in range(2):
            Q[i, j] = 0.0
            for k in range(3):
                Q[i, j] += B[i, k] * (A[j, k] - along * (a[k] + b[k]))


@hot
def cross(a: Array, b: Array) -> Array:
    """a x b (3,)."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
