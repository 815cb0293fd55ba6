"""Cholesky factors of small matrices in place, compiled; far cheaper below 12 x 12 than LAPACK."""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def factor(A: Array, n: int) -> float:
    """Overwrites the lower triangle of `A[:n, :n]` by L with A = L L^T; returns log det A.

    Only the lower triangle is read. NaN is returned where A is not positive definite.
    """
    log_determinant = 0.0
    for j in range(n):  # By columns: one division each, and rows that do not wait for each other.
        s = A[j, j]
        for k in range(j):
            s -= A[j, k] * A[j, k]
        if not s > 0.0:
            return np.nan
        root = np.sqrt(s)
        inverse = 1.0 / root
        A[j, j] = root
        log_determinant += np.log(s)
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s * inverse
    return log_determinant


@hot
def forward(L: Array, b: Array, n: int) -> None:
    """Overwrites `b[:n]` by L^-1 b."""
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * b[k]
        b[i] = s / L[i, i]


@hot
def backward(L: Array, b: Array, n: int) -> None:
    """Overwrites `b[:n]` by L^-T b."""
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= L[k, i] * b[k]
        b[i] = s / L[i, i]


@hot
def inverse(L: Array, out: Array, n: int) -> None:
    """Writes A^-1 = (L L^T)^-1, symmetric, into `out[:n, :n]`."""
    for j in range(n):  # First L^-1, lower triangular.
        out[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= L[i, k] * out[k, j]
            out[i, j] = s / L[i, i]
    for i in range(n):  # Then L^-T L^-1, in place from the first row down.
        for j in range(i + 1):
            s = 0.0
            for k in range(i, n):
                s += out[k, i] * out[k, j]
            out[i, j] = s
            out[j, i] = s
