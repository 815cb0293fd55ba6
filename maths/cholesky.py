"""Cholesky factors of small matrices in place, compiled; far cheaper below 12 x 12 than LAPACK."""

import numpy as np

from maths.arrays import Array
from maths.compiled import hot


@hot
def factor(A: Array, n: int) -> float:
    """Overwrites the lower triangle of `A[:n, :n]` by L with A = L L^T; returns log det A.

    Only the lower triangle is read. NaN is returned where A is not positive definite.
    """
    log_determinant = 0.0
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > 0.0:
                    return np.nan
                A[i, i] = np.sqrt(s)
                log_determinant += np.log(s)
            else:
                A[i, j] = s / A[j, j]
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
    column = np.empty(n)
    for j in range(n):
        for i in range(n):
            column[i] = 0.0
        column[j] = 1.0
        forward(L, column, n)
        backward(L, column, n)
        for i in range(n):
            out[i, j] = column[i]
    for i in range(n):
        for j in range(i):
            out[i, j] = out[j, i]
