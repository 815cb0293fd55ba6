"""By how much the errors of a stream of poses are correlated in time, from the stream itself.

A tracker that filters errs alike in neighbouring frames, so that its poses look far less noisy than
they claim to be, and wander instead. By how far a pose is off the geodesic between two others,
sideways to the motion, no joint matters; white noise does the same whether the others are the
neighbours or farther away, and correlated errors do less among neighbours. The errors are taken for
a first-order Gauss-Markov process with a correlation r between neighbouring frames, and no larger
than claimed: a stream that is as noisy as claimed among neighbours has white noise, and what
wanders is the child.
"""

from typing import Any, NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.keyframes.noise_scale import MEASURED, off_geodesic

_LAG = 4  # Frames between poses that are farther away.
_SIZE = 2 * _LAG + 1
_MEMORY = 150  # Distances that are remembered.
_LEAST = 8  # Distances before which nothing is said.
# How far the log ratio of two medians may be off, of one distance each: half its deviation.
_DOUBT = 0.7
_STRONGEST = 0.95
_WEAKEST = 0.3  # Correlation below which it is not told from none.


class NoiseCorrelation(NamedTuple):
    """What the latest poses show of their errors' correlation.

    Attributes:
        Z: (9, 4, 4) the latest poses, oldest first.
        R: (9, 6, 6) their claimed covariances.
        time: (9,) [s].
        seen: (1,) how many poses there were since the last break.
        near: (M,) squared distances of poses from their neighbours' geodesic, sideways to it and in
            units of the claimed covariance.
        far: (M,) the same from the geodesic between poses that are four frames away.
        known: (1,) how many of them there are.
    """

    Z: Array
    R: Array
    time: Array
    seen: Array
    near: Array
    far: Array
    known: Array


def initial_noise_correlation() -> NoiseCorrelation:
    """Before any measurement."""
    return NoiseCorrelation(
        Z=np.zeros((_SIZE, 4, 4)),
        R=np.zeros((_SIZE, 6, 6)),
        time=np.zeros(_SIZE),
        seen=np.zeros(1),
        near=np.zeros(_MEMORY),
        far=np.zeros(_MEMORY),
        known=np.zeros(1),
    )


@hot
def _distance(n: NoiseCorrelation, lag: int) -> float:
    """Squared distance of the middle pose from the geodesic between two, sideways to it."""
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    i, j, k = _LAG - lag, _LAG, _LAG + lag
    share = (n.time[j] - n.time[i]) / (n.time[k] - n.time[i])
    step, e, L = np.empty(6), np.empty(6), np.empty((6, 6))
    off_geodesic((n.Z[i], n.Z[j], n.Z[k]), (n.R[i], n.R[j], n.R[k]), share, step, e, L)
    cholesky.factor(L, six)
    cholesky.forward(L, e, six)
    cholesky.forward(L, step, six)
    along, length, square = 0.0, 0.0, 0.0
    for a in range(6):
        along += e[a] * step[a]
        length += step[a] * step[a]
        square += e[a] * e[a]
    return square - along * along / max(length, 1e-12)


@hot
def observe_correlation(n: NoiseCorrelation, X: Array, R: Array, time: float) -> None:
    """Adds one measured pose (4, 4) of claimed covariance R (6, 6), in place; time in [s]."""
    if n.seen[0] > 0.0 and time <= n.time[-1]:
        return
    n.Z[:-1], n.R[:-1], n.time[:-1] = n.Z[1:].copy(), n.R[1:].copy(), n.time[1:].copy()
    n.Z[-1], n.R[-1], n.time[-1] = X, R, time
    n.seen[0] += 1.0
    rotations = int((n.R[:, 0, 0] < MEASURED).sum())  # Near and far must compare the same.
    if n.seen[0] >= _SIZE and (rotations == 0 or rotations == _SIZE):
        at = int(n.known[0]) % _MEMORY
        n.near[at], n.far[at] = _distance(n, 1), _distance(n, _LAG)
        n.known[0] += 1.0


@hot
def _variance(r: Any) -> Any:
    """Variance of a pose off the mean of two others, of errors of unit variance.

    Args:
        r: Correlation with either of them, and the root of that between those.
    """
    return 1.5 - 2.0 * r + 0.5 * r * r


@hot
def _correlation(n: NoiseCorrelation, scale: float) -> float:
    """Correlation r of the errors of neighbouring frames; zero where it is not told from none.

    Args:
        n: What the poses show.
        scale: Square of the noise's scale among neighbours, see `NoiseScale.variance`.
    """
    # With more than this they would be larger than claimed.
    most = min(2.0 - np.sqrt(1.0 + 3.0 * min(scale, 1.0)), _STRONGEST)
    known = min(int(n.known[0]), _MEMORY)
    if known < _LEAST or most <= _WEAKEST:
        return 0.0
    ratio = np.median(n.far[:known]) / max(np.median(n.near[:known]), 1e-12)
    ratio *= np.exp(-_DOUBT / np.sqrt(known))
    low, high = 0.0, most
    for _ in range(20):
        r = 0.5 * (low + high)
        if _variance(r**_LAG) < ratio * _variance(r):
            low = r
        else:
            high = r
    return low if low > _WEAKEST else 0.0


def correlations(n: NoiseCorrelation, scales: Array) -> Array:
    """See `_correlation`; for several scales."""
    return np.array([_correlation(n, float(scale)) for scale in scales])


def inflation(r: Array) -> Array:
    """Of the scale's square: that of white noise whose average over long is as uncertain.

    The scale is that of neighbours, among whom correlated errors look small.
    """
    return np.asarray(1.5 * (1.0 + r) / ((1.0 - r) * _variance(r)))
