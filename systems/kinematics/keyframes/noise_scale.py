"""By how much the claimed covariances of a stream of poses are wrong, from the stream itself.

No joint is needed for it: a pose should be where its two neighbours in time say, on the geodesic
between them, up to the three poses' noise and to what the child has accelerated. The squared
differences, without those that an outlier explains, are the data of an inverse-gamma posterior of
the noise's scale; rotation and translation have one each.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.se3_in_place import perturb, pose_difference, relative_log

UNKNOWN = 1e4  # Variance of what was not measured, [rad^2] or [m^2].
MEASURED = 10.0  # From which a direction was not: far below, for averages are made of it, too.
_PRIOR = 6.0  # Degrees of freedom of the prior, in which the claim is right.
_MEDIAN = 2.365974  # Of a chi-square of three degrees of freedom.
_MOST_LIKELY = 11.344867  # Its 99 % quantile, above which a difference is one with an outlier,
_MEAN_BELOW = 2.894075  # and its mean below that.
_DOUBT = 1.0  # Log odds of the claim against a variance e times as large, [nat].
_BEFORE = 16.0  # Differences that the prior of their share counts, one of them with an outlier.
_LOG_RANGE = np.log(1e4)  # Of what an outlier makes of a square.
_INDEPENDENT = 0.5  # Share of what neighbouring differences, which have poses in common, tell.
_MEMORY = 150  # Differences that are remembered.
_ITERATIONS = 3
_LEAST, _MOST = 0.05**2, 100.0**2  # Of the scale's square.


class NoiseScale(NamedTuple):
    """Arrays for two kinds of error, rotation and translation.

    Attributes:
        Z: (2, 4, 4) the last two poses, older first.
        R: (2, 6, 6) their claimed covariances.
        time: (2,) [s].
        seen: (1,) how many poses there were.
        squares: (2, M) squares of the latest differences, in units of the claimed covariance.
        known: (2,) how many of them there are.
        variance: (2,) posterior mean of the scale's square.
    """

    Z: Array
    R: Array
    time: Array
    seen: Array
    squares: Array
    known: Array
    variance: Array


def initial_noise_scale() -> NoiseScale:
    """Before any measurement."""
    return NoiseScale(
        Z=np.zeros((2, 4, 4)),
        R=np.zeros((2, 6, 6)),
        time=np.zeros(2),
        seen=np.zeros(1),
        squares=np.zeros((2, _MEMORY)),
        known=np.zeros(2),
        variance=np.ones(2),
    )


@hot
def mean_claim(claim: Array, count: int, covariance: Array) -> Array:
    """The harmonic mean (6, 6) of covariances, one more counted than the `count` in `claim`.

    What was not measured does not count, and one that is far too large hardly does.
    """
    six, out = int(np.int64(6)), np.empty((6, 6))
    W = _inverse(covariance) / (count + 1.0)
    if count > 0:
        W += _inverse(claim) * (count / (count + 1.0))
    cholesky.factor(W, six)
    cholesky.inverse(W, out, six)
    return out


@hot
def _inverse(R: Array) -> Array:
    six, L, out = int(np.int64(6)), R.copy(), np.empty((6, 6))
    cholesky.factor(L, six)
    cholesky.inverse(L, out, six)
    return out


@hot
def off_geodesic(
    Z: tuple[Array, Array, Array],
    R: tuple[Array, Array, Array],
    share: float,
    step: Array,
    e: Array,
    C: Array,
) -> None:
    """How far the middle one of three poses is off the geodesic between the other two.

    Args:
        Z: The poses, (4, 4) each.
        R: Their covariances, (6, 6) each.
        share: Of the time between the outer ones that has passed at the middle one.
        step: (6,) from the first to the last pose, a result.
        e: (6,) by how far it is off, a result.
        C: Covariance (6, 6) of that, a result.
    """
    between = np.empty((4, 4))
    relative_log(Z[0], Z[2], step)
    perturb(Z[0], share * step, between)
    pose_difference(between, Z[1], e)
    C[:] = R[1] + (1.0 - share) ** 2 * R[0] + share**2 * R[2]


@hot
def _largest(R: Array, i: int) -> float:
    """The largest variance of rotation (0) or translation (1)."""
    return max(R[3 * i, 3 * i], R[3 * i + 1, 3 * i + 1], R[3 * i + 2, 3 * i + 2])


@hot
def _posterior(squares: Array, variance: float) -> tuple[float, float]:
    """The posterior mean of the scale's square near `variance`, and its log posterior.

    The size of a difference with an outlier is evenly distributed in its logarithm.
    """
    likely, mean = 0, 0.0
    for _ in range(_ITERATIONS):
        total, likely = 0.0, 0
        for square in squares:
            if square <= _MOST_LIKELY * variance:
                total += square
                likely += 1
        weight = 3.0 * _INDEPENDENT * likely
        mean = total / max(likely, 1) / _MEAN_BELOW
        variance = (_PRIOR + weight * mean) / (_PRIOR + weight)
    limit = _MOST_LIKELY * variance
    share = (squares.size - likely + 1.0) / (squares.size + _BEFORE)
    inside = np.log((1.0 - share) / (np.sqrt(2.0 * np.pi) * variance))
    outside = np.log(share / _LOG_RANGE)
    value = -_DOUBT * (np.log(variance) + 1.0 / variance)
    for square in squares:
        x = square / variance
        if square <= limit:
            value += _INDEPENDENT * (inside + 0.5 * np.log(x) - 0.5 * x)
        else:
            value += _INDEPENDENT * (outside - np.log(square))
    return variance, value


@hot
def _fit(n: NoiseScale, i: int, least: float) -> None:
    """The posterior mean of the scale's square, from all differences that no outlier explains.

    Where most of the first poses are outliers, the differences' median is one's, so that the claim
    is tried, too.
    """
    squares = n.squares[i, : min(int(n.known[i]), _MEMORY)]
    variance, value = _posterior(squares, float(np.median(squares)) / _MEDIAN)
    claimed, value_claimed = _posterior(squares, 1.0)
    if value_claimed > value:
        variance = claimed
    n.variance[i] = min(max(variance, least, _LEAST), _MOST)


def own_scale(n: NoiseScale) -> Array:
    """(6,) standard deviations of one measurement's noise by those that it claims."""
    return np.repeat(np.sqrt(n.variance), 3)


def degrees_of_freedom(n: NoiseScale) -> float:
    """Of the scale's posterior, that of rotation or translation which is better known."""
    known = min(float(n.known.max()), _MEMORY)
    return _PRIOR + 3.0 * _INDEPENDENT * known


@hot
def observe(n: NoiseScale, X: Array, R: Array, time: float, least: float) -> None:
    """Adds one measured pose, in place.

    Args:
        n: The scale.
        X: Measured pose (4, 4).
        R: Its claimed covariance (6, 6), in B.
        time: Of the measurement, [s].
        least: Of the scale's square: one where errors are correlated, which differences hide.
    """
    if n.seen[0] >= 2.0 and time > n.time[1] > n.time[0]:
        step, e, C = np.empty(6), np.empty(6), np.empty((6, 6))
        share = (n.time[1] - n.time[0]) / (time - n.time[0])
        off_geodesic((n.Z[0], n.Z[1], X), (n.R[0], n.R[1], R), share, step, e, C)
        three = int(np.int64(3))  # For a literal, Numba would compile all callees again.
        for i in range(2):
            if max(_largest(n.R[0], i), _largest(n.R[1], i), _largest(R, i)) > MEASURED:
                continue
            L, x = C[3 * i : 3 * i + 3, 3 * i : 3 * i + 3].copy(), e[3 * i : 3 * i + 3].copy()
            cholesky.factor(L, three)
            cholesky.forward(L, x, three)
            square = x[0] ** 2 + x[1] ** 2 + x[2] ** 2
            n.squares[i, int(n.known[i]) % _MEMORY] = square
            n.known[i] += 1.0
            _fit(n, i, least)
    n.Z[0], n.R[0], n.time[0] = n.Z[1], n.R[1], n.time[1]
    n.Z[1], n.R[1], n.time[1] = X, R, time
    n.seen[0] += 1.0
