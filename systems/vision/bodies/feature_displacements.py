"""How far features moved relative to a moving frame, with the covariance of that, compiled."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory

REST_COUNT = 20  # Number of samples that the mean of a feature at rest counts as.


@dataclass(kw_only=True)
class Displacements:
    """How far features moved, relative to a moving frame, between earlier and their newest samples.

    Attributes:
        p_old: Earlier mean position in the frame (N, 3), [m].
        p_new: Newest mean position in the frame (N, 3), [m].
        C_old: Covariance (N, 3, 3) of the earlier mean, [m^2].
        C_new: Covariance (N, 3, 3) of the newest mean.
        count_old: Earlier samples used (N,); those of the rest count as `REST_COUNT`.
        count_new: Newest samples used (N,).
    """

    p_old: Array
    p_new: Array
    C_old: Array
    C_new: Array
    count_old: Ids
    count_new: Ids


@hot
def _accumulate(
    R: Array, t: Array, information: Array, moment: Array, total: Array, total_moment: Array
) -> None:
    """Adds one sample's information and moment, given in W, to sums in B = (R_WB, t_WB).

    The moment is that of the position; in B it is R^T (moment - information t). Written out: the
    matrix product of a library costs more than these 3x3 ones.
    """
    shifted = np.empty(3)
    half = np.empty((3, 3))
    for a in range(3):
        shifted[a] = moment[a]
        for b in range(3):
            shifted[a] -= information[a, b] * t[b]
            half[a, b] = (
                information[a, 0] * R[0, b]
                + information[a, 1] * R[1, b]
                + information[a, 2] * R[2, b]
            )
    for a in range(3):
        total_moment[a] += R[0, a] * shifted[0] + R[1, a] * shifted[1] + R[2, a] * shifted[2]
        for b in range(3):
            total[a, b] += R[0, a] * half[0, b] + R[1, a] * half[1, b] + R[2, a] * half[2, b]


@hot
def _inverse(A: Array, out: Array) -> None:
    """Inverse of a symmetric positive definite (3, 3) matrix."""
    a, b, c = A[0, 0], A[0, 1], A[0, 2]
    d, e, f = A[1, 1], A[1, 2], A[2, 2]
    out[0, 0], out[0, 1], out[0, 2] = d * f - e * e, c * e - b * f, b * e - c * d
    out[1, 1], out[1, 2], out[2, 2] = a * f - c * c, b * c - a * e, a * d - b * b
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    determinant = a * out[0, 0] + b * out[0, 1] + c * out[0, 2]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant


@hot
def _means(
    p_W: Array,
    information: Array,
    rest_information: Array,
    rest_moment: Array,
    use_rest: Mask,
    X_WB: Array,
    X_WB_rest: Array,
    still: bool,
    first_old: int,
    last_old: int,
    newest: int,
) -> tuple[Array, Array, Array, Array, Ids, Ids]:
    """Information-weighted means of samples [first_old, last_old] and of the newest ones, in B."""
    count, window = p_W.shape[:2]
    p = np.zeros((2, count, 3))
    C = np.zeros((2, count, 3, 3))
    number = np.zeros((2, count), dtype=np.int64)
    moment = np.empty(3)
    for i in range(count):
        total = np.zeros((2, 3, 3))
        total_moment = np.zeros((2, 3))
        if use_rest[i] and rest_information[i, 0, 0] > 0.0:
            number[0, i] += REST_COUNT
            if still:
                total[0] += rest_information[i]
                total_moment[0] += rest_moment[i]
            else:
                _accumulate(
                    X_WB_rest[:3, :3],
                    X_WB_rest[:3, 3],
                    rest_information[i],
                    rest_moment[i],
                    total[0],
                    total_moment[0],
                )
        for k in range(window):
            old = first_old <= k <= last_old
            if information[i, k, 0, 0] <= 0.0 or not (old or k >= window - newest):
                continue
            side = 0 if old else 1
            for a in range(3):
                moment[a] = 0.0
                for b in range(3):
                    moment[a] += information[i, k, a, b] * p_W[i, k, b]
            number[side, i] += 1
            if still:
                for a in range(3):
                    total_moment[side, a] += moment[a]
                    for b in range(3):
                        total[side, a, b] += information[i, k, a, b]
                continue
            _accumulate(
                X_WB[k, :3, :3],
                X_WB[k, :3, 3],
                information[i, k],
                moment,
                total[side],
                total_moment[side],
            )
        for side in range(2):
            if number[side, i] > 0:
                _inverse(total[side], C[side, i])
                for a in range(3):
                    for b in range(3):
                        p[side, i, a] += C[side, i, a, b] * total_moment[side, b]
    return p[0], p[1], C[0], C[1], number[0], number[1]


def displacements(
    history: FeatureHistory,
    *,
    newest: int,
    X_WB: Array | None = None,
    use_rest: Mask | None = None,
    X_WB_rest: Array | None = None,
    first_old: int = 0,
    last_old: int | None = None,
) -> Displacements:
    """How far the features moved relative to frame B.

    Args:
        history: N features, H ticks.
        newest: Ticks at the window's end that make the newest mean.
        X_WB: The frame's path over the window (H, 4, 4), oldest first; default the world.
        use_rest: For which features (N,) the rest counts as earlier samples; default all.
        X_WB_rest: Where the frame was during the rest (4, 4); default where it was first.
        first_old: First tick of the window that makes the earlier mean.
        last_old: Last tick that does; default the one before the newest.
    """
    window = history.p_W.shape[1]
    still = X_WB is None
    path = np.eye(4)[None] if X_WB is None else X_WB
    use_rest = np.ones(len(history.ids), bool) if use_rest is None else use_rest
    last = window - newest - 1 if last_old is None else last_old
    p_old, p_new, C_old, C_new, count_old, count_new = _means(
        history.p_W,
        history.information,
        history.rest_information,
        history.rest_moment,
        use_rest,
        np.ascontiguousarray(path),
        np.ascontiguousarray(path[0] if X_WB_rest is None else X_WB_rest),
        still,
        first_old,
        last,
        newest,
    )
    return Displacements(
        p_old=p_old,
        p_new=p_new,
        C_old=C_old,
        C_new=C_new,
        count_old=count_old,
        count_new=count_new,
    )


def squared_distances(e: Array, S: Array) -> tuple[Array, Array]:
    """Squared Mahalanobis lengths (N,) of errors (N, 3), and log determinants (N,) of S."""
    L = np.linalg.cholesky(S)
    whitened = np.linalg.solve(L, e[:, :, None])[:, :, 0]
    log_determinant = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    return np.sum(whitened**2, axis=1), log_determinant
