"""Whether errors are as large as their covariances say."""

import numpy as np
import scipy.special

from crossmodal.maths.arrays import Array


def normalised_squared_error(error: Array, covariance: Array) -> float:
    """NEES of an error (n,): infinite where the covariance (n, n) is not positive definite.

    NaN gives NaN. The filters use `gaussian.nees`, which is compiled and refuses both.
    """
    try:
        L = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return float("inf")
    whitened = np.linalg.solve(L, error)
    return float(whitened @ whitened)


def chi_square_quantile(probability: float, degrees: int) -> float:
    """The value below which a chi-square of so many degrees of freedom is with this probability.

    That of `scipy.stats`, whose import takes half a second.
    """
    return float(2.0 * scipy.special.gammaincinv(0.5 * degrees, probability))


def chi_square_bounds(degrees: int, probability: float = 0.95) -> tuple[float, float]:
    """The two-sided bounds inside which a consistent error's NEES is with this probability."""
    tail = 0.5 - 0.5 * probability
    return chi_square_quantile(tail, degrees), chi_square_quantile(1.0 - tail, degrees)


def is_consistent(error: Array, covariance: Array) -> bool:
    """Whether the NEES of an error (n,) is inside its 95 % bounds."""
    low, high = chi_square_bounds(error.size)
    return low <= normalised_squared_error(error, covariance) <= high


def share_inside(values: Array, degrees: int) -> float:
    """Share of NEES inside their 95 % bounds; NaN where there is no value."""
    if len(values) == 0:
        return float("nan")
    low, high = chi_square_bounds(degrees)
    return float(np.mean((values >= low) & (values <= high)))


def share_above(values: Array, degrees: int) -> float:
    """Share of NEES above their 95 % bounds, of errors too large for what was reported; or NaN."""
    if len(values) == 0:
        return float("nan")
    return float(np.mean(values > chi_square_bounds(degrees)[1]))
