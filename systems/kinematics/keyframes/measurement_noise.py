"""How large and how correlated the noise of a stream of poses is, from the stream itself.

No joint is needed for it: a pose should be on the geodesic between its two neighbours in time, up
to the three poses' noise and to what the child has accelerated. The squared differences, without
those that an outlier explains, are the data of an inverse-gamma posterior of the noise's scale
against the reported covariance; rotation and translation have one each.

The poses of a tracker that filters have correlated errors: they look far less noisy than their
reported covariance, and wander instead. White noise takes a pose as far off the geodesic between
two neighbours as off that between two poses farther away; correlated errors take it less far among
neighbours. Only the part sideways to the motion is compared, so that the child's acceleration does
not count. The errors are modelled as a first-order Gauss-Markov process with a correlation r
between neighbouring frames, no larger than reported: a stream that is as noisy as reported among
neighbours has white noise, and what wanders is the child.
"""

from typing import Any, NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import perturb, pose_difference, relative_log

UNKNOWN = 1e4  # Variance of what was not measured, [rad^2] or [m^2].
MEASURED = 10.0  # A direction of a larger variance was not measured, nor was an average of such.
_PRIOR = 6.0  # Degrees of freedom of the prior, in which the reported covariance is right.
_MEDIAN = 2.365974  # Of a chi-square of three degrees of freedom.
_MOST_LIKELY = 11.344867  # Its 99 % quantile, above which a difference is one with an outlier,
_MEAN_BELOW = 2.894075  # and its mean below that.
_DOUBT = 1.0  # Log odds of the reported variance against one e times as large, [nat].
_BEFORE = 16.0  # Differences in the prior of the outliers' share, one of them with one.
_LOG_RANGE = np.log(1e4)  # Log range of the squares of differences with an outlier.
_INDEPENDENT = 0.5  # Independent differences per difference: neighbours have poses in common.
_MEMORY = 150  # Differences that are remembered.
_ITERATIONS = 3
_LEAST, _MOST = 0.05**2, 100.0**2  # Of the scale's square.
_LAG = 4  # Frames between poses that are no neighbours.
_SIZE = 2 * _LAG + 1
_LEAST_COMPARED = 8  # Pairs of distances before which the noise counts as white.
# The log ratio of two medians has about twice this deviation, divided by the root of their number.
_RATIO_DOUBT = 0.7
_STRONGEST = 0.95
_WEAKEST = 0.3  # A smaller correlation is not told from none.


class MeasurementNoise(NamedTuple):
    """What the latest poses show; arrays of two are for rotation and translation.

    Attributes:
        Z: (9, 4, 4) the latest poses, oldest first.
        R: (9, 6, 6) their reported covariances.
        time: (9,) [s].
        seen: (1,) how many poses there were since the last break.
        squares: (2, M) squares of the latest differences, in units of the reported covariance.
        known: (2,) how many of them there are.
        variance: (2,) posterior mean of the scale's square.
        near: (M,) squared distances of poses from their neighbours' geodesic, sideways to it and in
            units of the reported covariance.
        far: (M,) the same from the geodesic between poses that are four frames away.
        compared: (1,) how many of these pairs there are.
    """

    Z: Array
    R: Array
    time: Array
    seen: Array
    squares: Array
    known: Array
    variance: Array
    near: Array
    far: Array
    compared: Array


def initial_noise() -> MeasurementNoise:
    """Before any measurement."""
    return MeasurementNoise(
        Z=np.zeros((_SIZE, 4, 4)),
        R=np.zeros((_SIZE, 6, 6)),
        time=np.zeros(_SIZE),
        seen=np.zeros(1),
        squares=np.zeros((2, _MEMORY)),
        known=np.zeros(2),
        variance=np.ones(2),
        near=np.zeros(_MEMORY),
        far=np.zeros(_MEMORY),
        compared=np.zeros(1),
    )


@hot
def mean_covariance(mean: Array, count: int, covariance: Array) -> Array:
    """The harmonic mean (6, 6) of covariances, one more counted than the `count` in `mean`.

    What was not measured does not count, and one that is far too large hardly does.
    """
    six, out = int(np.int64(6)), np.empty((6, 6))
    W = _inverse(covariance) / (count + 1.0)
    if count > 0:
        W += _inverse(mean) * (count / (count + 1.0))
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
    assign(C, R[1] + (1.0 - share) ** 2 * R[0] + share**2 * R[2])


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
def _fit(n: MeasurementNoise, i: int, least: float) -> None:
    """The posterior mean of the scale's square, from all differences that no outlier explains.

    Where most of the first poses are outliers, the median difference is one with an outlier.
    Therefore the search starts from the reported covariance, too.
    """
    squares = n.squares[i, : min(int(n.known[i]), _MEMORY)]
    variance, value = _posterior(squares, float(np.median(squares)) / _MEDIAN)
    reported, value_reported = _posterior(squares, 1.0)
    if value_reported > value:
        variance = reported
    n.variance[i] = min(max(variance, least, _LEAST), _MOST)


def estimated_scale(n: MeasurementNoise) -> Array:
    """(6,) standard deviations of one measurement's noise by those that it reports."""
    return np.repeat(np.sqrt(n.variance), 3)


def degrees_of_freedom(n: MeasurementNoise) -> float:
    """Of the scale's posterior, that of rotation or translation which is better known."""
    known = min(float(n.known.max()), _MEMORY)
    return _PRIOR + 3.0 * _INDEPENDENT * known


@hot
def _observe_scale(n: MeasurementNoise, least: float) -> None:
    """Adds the difference of the newest pose but one from the geodesic between its neighbours."""
    before, now, after = n.time[-3], n.time[-2], n.time[-1]
    if n.seen[0] < 3.0 or not after > now > before:
        return
    share = (now - before) / (after - before)
    step, e, C = np.empty(6), np.empty(6), np.empty((6, 6))
    off_geodesic((n.Z[-3], n.Z[-2], n.Z[-1]), (n.R[-3], n.R[-2], n.R[-1]), share, step, e, C)
    three = int(np.int64(3))  # For a literal, Numba would compile all callees again.
    for i in range(2):
        if max(_largest(n.R[-3], i), _largest(n.R[-2], i), _largest(n.R[-1], i)) > MEASURED:
            continue
        L, x = C[3 * i : 3 * i + 3, 3 * i : 3 * i + 3].copy(), e[3 * i : 3 * i + 3].copy()
        cholesky.factor(L, three)
        cholesky.forward(L, x, three)
        n.squares[i, int(n.known[i]) % _MEMORY] = x[0] ** 2 + x[1] ** 2 + x[2] ** 2
        n.known[i] += 1.0
        _fit(n, i, least)


@hot
def _distance(n: MeasurementNoise, lag: int) -> float:
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
def _compare_distances(n: MeasurementNoise) -> None:
    """Adds the distances of the middle pose from both geodesics."""
    rotations = int((n.R[:, 0, 0] < MEASURED).sum())  # Both must be measured in the same way.
    if n.seen[0] < _SIZE or 0 < rotations < _SIZE or np.diff(n.time).min() <= 0.0:
        return
    at = int(n.compared[0]) % _MEMORY
    n.near[at], n.far[at] = _distance(n, 1), _distance(n, _LAG)
    n.compared[0] += 1.0


@hot
def observe(
    n: MeasurementNoise, X: Array, R: Array, time: float, correlation_is_specified: bool
) -> None:
    """Adds one measured pose, in place.

    Args:
        X: Measured pose (4, 4).
        R: Its reported covariance (6, 6), in B.
        time: Of the measurement, [s].
        correlation_is_specified: Whether R is already that of correlated errors. They are hidden
            from differences of neighbours, so that the scale is one at least, and no other
            correlation is looked for.
    """
    n.Z[:-1], n.R[:-1], n.time[:-1] = n.Z[1:].copy(), n.R[1:].copy(), n.time[1:].copy()
    n.Z[-1], n.R[-1], n.time[-1] = X, R, time
    n.seen[0] += 1.0
    _observe_scale(n, 1.0 if correlation_is_specified else 0.0)
    if not correlation_is_specified:
        _compare_distances(n)


@hot
def _variance(r: Any) -> Any:
    """Variance of a pose off the mean of two others, of errors of unit variance.

    Args:
        r: Correlation with either of them, and the root of that between those.
    """
    return 1.5 - 2.0 * r + 0.5 * r * r


@hot
def _correlation(n: MeasurementNoise, scale: float) -> float:
    """See `correlations`; for one scale's square."""
    # With more than this the errors would be larger than reported.
    most = min(2.0 - np.sqrt(1.0 + 3.0 * min(scale, 1.0)), _STRONGEST)
    known = min(int(n.compared[0]), _MEMORY)
    if known < _LEAST_COMPARED or most <= _WEAKEST:
        return 0.0
    ratio = np.median(n.far[:known]) / max(np.median(n.near[:known]), 1e-12)
    ratio *= np.exp(-_RATIO_DOUBT / np.sqrt(known))
    low, high = 0.0, most
    for _ in range(20):
        r = 0.5 * (low + high)
        if _variance(r**_LAG) < ratio * _variance(r):
            low = r
        else:
            high = r
    return low if low > _WEAKEST else 0.0


def correlations(n: MeasurementNoise) -> Array:
    """Correlation r (2,) of the errors of neighbouring frames; zero where it is not told from none.

    Of rotation and translation; only the limit by the scale differs.
    """
    return np.array([_correlation(n, float(scale)) for scale in n.variance])


def inflation(r: Array) -> Array:
    """Factor on the scale's square for errors with the correlations r.

    With it, white noise has an average over long as uncertain as that of the correlated errors. The
    scale is that of neighbours, among whom correlated errors look small.
    """
    return np.asarray(1.5 * (1.0 + r) / ((1.0 - r) * _variance(r)))
