"""What measurements with correlated errors are worth to a filter that takes them for white.

The errors are first-order Gauss-Markov processes, each of a standard deviation sigma and a time
constant tau: their covariance after a time t is sigma^2 exp(-t / tau).
"""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number

_LEAST_WHITE = 1e-2  # Least share of a measurement's own variance that is white.
EXACT = 1e-12 * np.eye(6)  # Added to every covariance, for exact ones, [rad^2, m^2].


@dataclass(kw_only=True)
class MeasurementErrorsConfig:
    """The correlated errors of a stream of measurements; none by default, which is white noise.

    A measurement that is another filter's posterior errs alike for a while, so that averaging n of
    them gains less than n. With these settings the configuration's covariance is honest or too
    large, never too small.

    Attributes:
        correlation_time: tau of each measurement's error as a whole; zero for white noise.
        wander: Probability that rotations err smoothly by degrees without reporting it, as those of
            fiducials and of trackers of models do; what the poses show decides. Only where no other
            error is correlated.
        declared_time: tau of the part of its covariance that a measurement itself declares to be
            correlated; zero to take that part for white.
    """

    correlation_time: float = number(0.0, at_least=0.0, at_most=1e5, unit="s")
    wander: float = number(0.5, at_least=0.0, at_most=0.99)
    declared_time: float = number(0.0, at_least=0.0, at_most=1e5, unit="s")


def is_correlated(config: MeasurementErrorsConfig) -> bool:
    """Whether any error is other than white."""
    return config.correlation_time > 0.0 or config.declared_time > 0.0


def _own_equivalent(covariance: Array, dt: float, config: MeasurementErrorsConfig) -> Array:
    """The white equivalent (6, 6) of the measurement's own error, none of it declared."""
    R = covariance + EXACT
    if dt > 0.0 and config.correlation_time > 0.0:
        r = np.exp(-dt / config.correlation_time)
        R = R * ((1.0 + r) / (1.0 - r))
    return R


def white_equivalent(
    covariance: Array, dt: float, config: MeasurementErrorsConfig, correlated: Array
) -> Array:
    """The covariance (6, 6) of white noise whose average over long is as uncertain.

    For measurements a time dt << tau apart it is 2 tau / dt times that of the correlated error; for
    the error as a whole, (1 + r) / (1 - r) times with r = exp(-dt / tau).

    Args:
        dt: Since the last one, [s].
        correlated: The part (6, 6) of the covariance that is declared to be correlated.
    """
    R = _own_equivalent(covariance, dt, config)
    if dt <= 0.0:
        return R
    return R + correlated * max(0.0, 2.0 * config.declared_time / dt - 1.0)


def correlated_shares(r: float) -> tuple[float, float]:
    """What `error_shares` are of errors with a correlation r from one measurement to the next."""
    return (1.0 - r) ** 2 / (1.0 + r), r * (1.0 - r) / (1.0 + r)


def error_shares(
    covariance: Array, R: Array, dt: float, config: MeasurementErrorsConfig, correlated: Array
) -> tuple[float, float]:
    """The shares of R, from `white_equivalent`, of one measurement's white and correlated variance.

    Their sum is at most one: the rest of R makes up for averages that gain less than they seem to.
    """
    if dt <= 0.0:
        return 1.0, 0.0

    def share(part: Array) -> float:
        return float(np.trace(np.linalg.solve(R, part))) / 6.0

    own = share(_own_equivalent(covariance, dt, config))
    r = np.exp(-dt / config.correlation_time) if config.correlation_time > 0.0 else 0.0
    white, rest, tau = own, 0.0, config.declared_time
    if tau > 0.0:
        rest = (1.0 - own) * min(1.0, 0.5 * dt / tau)
        white = max(own - share(correlated), _LEAST_WHITE * own)
    of_white, of_correlated = correlated_shares(r)
    return white * of_white, own * of_correlated + rest
