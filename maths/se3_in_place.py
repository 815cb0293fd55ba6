"""SE(3) for innermost loops, compiled: exponential and logarithm that write into given arrays.

Poses are (4, 4), tangent vectors (6,), rotation [rad] before translation [m].
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def _quaternion(R: tuple[float, ...]) -> tuple[float, float, float, float]:
    """A multiple (w >= 0, x, y, z) of the quaternion of the rotation `R`, row by row.

    Its largest component is taken first, so that it is as accurate near pi as near zero.
    """
    trace = R[0] + R[4] + R[8]
    if trace > 0.0:
        w, x, y, z = 1.0 + trace, R[7] - R[5], R[2] - R[6], R[3] - R[1]
    elif R[0] >= R[4] and R[0] >= R[8]:
        w, x, y, z = R[7] - R[5], 1.0 + 2.0 * R[0] - trace, R[1] + R[3], R[2] + R[6]
    elif R[4] >= R[8]:
        w, x, y, z = R[2] - R[6], R[1] + R[3], 1.0 + 2.0 * R[4] - trace, R[5] + R[7]
    else:
        w, x, y, z = R[3] - R[1], R[2] + R[6], R[5] + R[7], 1.0 + 2.0 * R[8] - trace
    return (-w, -x, -y, -z) if w < 0.0 else (w, x, y, z)


@hot
def pose_difference(A: Array, B: Array, xi: Array) -> None:
    """Writes rotation vector and translation (6,) of A^-1 B into `xi`; allocates nothing.

    Close to zero it is `relative_log`, but the translation has nothing to do with the rotation,
    which may not have been measured.
    """
    R = (
        A[0, 0] * B[0, 0] + A[1, 0] * B[1, 0] + A[2, 0] * B[2, 0],
        A[0, 0] * B[0, 1] + A[1, 0] * B[1, 1] + A[2, 0] * B[2, 1],
        A[0, 0] * B[0, 2] + A[1, 0] * B[1, 2] + A[2, 0] * B[2, 2],
        A[0, 1] * B[0, 0] + A[1, 1] * B[1, 0] + A[2, 1] * B[2, 0],
        A[0, 1] * B[0, 1] + A[1, 1] * B[1, 1] + A[2, 1] * B[2, 1],
        A[0, 1] * B[0, 2] + A[1, 1] * B[1, 2] + A[2, 1] * B[2, 2],
        A[0, 2] * B[0, 0] + A[1, 2] * B[1, 0] + A[2, 2] * B[2, 0],
        A[0, 2] * B[0, 1] + A[1, 2] * B[1, 1] + A[2, 2] * B[2, 1],
        A[0, 2] * B[0, 2] + A[1, 2] * B[1, 2] + A[2, 2] * B[2, 2],
    )
    d0, d1, d2 = B[0, 3] - A[0, 3], B[1, 3] - A[1, 3], B[2, 3] - A[2, 3]
    xi[3] = A[0, 0] * d0 + A[1, 0] * d1 + A[2, 0] * d2
    xi[4] = A[0, 1] * d0 + A[1, 1] * d1 + A[2, 1] * d2
    xi[5] = A[0, 2] * d0 + A[1, 2] * d1 + A[2, 2] * d2
    w, x, y, z = _quaternion(R)
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 / w if sine < 1e-9 * w else 2.0 * np.arctan2(sine, w) / sine
    xi[0], xi[1], xi[2] = scale * x, scale * y, scale * z


@hot
def relative_log(A: Array, B: Array, xi: Array) -> None:
    """Writes log(A^-1 B) (6,) of two poses (4, 4) into `xi`; allocates nothing."""
    pose_difference(A, B, xi)
    x, y, z = xi[0], xi[1], xi[2]
    t0, t1, t2 = xi[3], xi[4], xi[5]
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    # (1 - h cot h) / |omega|^2 with h = |omega| / 2
    k = (1.0 - half / np.tan(half)) / (4.0 * half * half) if half > 1e-3 else 1.0 / 12.0
    c0, c1, c2 = y * t2 - z * t1, z * t0 - x * t2, x * t1 - y * t0
    xi[3] = t0 - 0.5 * c0 + k * (y * c2 - z * c1)
    xi[4] = t1 - 0.5 * c1 + k * (z * c0 - x * c2)
    xi[5] = t2 - 0.5 * c2 + k * (x * c1 - y * c0)


@hot
def perturb(X: Array, xi: Array, out: Array) -> None:
    """Writes X exp(xi) (4, 4) into `out`, which may be X."""
    x, y, z = xi[0], xi[1], xi[2]
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    if angle < 1e-4:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0
    else:
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / square
        c = (1.0 - a) / square
    E, V = np.empty((3, 3)), np.empty((3, 3))
    w = (x, y, z)
    for i in range(3):
        for j in range(3):
            outer = w[i] * w[j] - (square if i == j else 0.0)
            E[i, j] = b * outer + (1.0 if i == j else 0.0)
            V[i, j] = c * outer + (1.0 if i == j else 0.0)
    for i, j, s in ((0, 1, -z), (0, 2, y), (1, 2, -x)):
        E[i, j] += a * s
        E[j, i] -= a * s
        V[i, j] += b * s
        V[j, i] -= b * s
    Y = X.copy()
    for i in range(3):
        p = Y[i, 3]
        for j in range(3):
            p += Y[i, j] * (V[j, 0] * xi[3] + V[j, 1] * xi[4] + V[j, 2] * xi[5])
            out[i, j] = Y[i, 0] * E[0, j] + Y[i, 1] * E[1, j] + Y[i, 2] * E[2, j]
        out[i, 3] = p
        out[3, i] = 0.0
    out[3, 3] = 1.0
