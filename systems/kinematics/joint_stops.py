"""End stops and latches of a joint, from how hard it was pushed where it rested."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit
from scipy.stats import exponnorm, norm

from maths.arrays import Array
from maths.immutable import Immutable
from systems.port_values import LatchBelief, LimitBelief

_QUANTILES = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
_STRANGE = 1e-3  # Share of the rests under friction alone that are pushed as hard as at a stop.
_LONGEST = 16  # Rests that are remembered.


@dataclass(frozen=True, kw_only=True)
class Rest(Immutable):
    """The joint has stood still.

    Attributes:
        q: Where, [m or rad].
        variance: Of that.
        push: By direction -1 and 1: (n,) sample z at which the push that way was the hardest.
        pushed: By direction, how hard it was when it was chosen.
        release: Direction in which it moved on; 0 while it has not.
        peak: (n,) Sample z of the hardest push that way before it moved on.
    """

    q: float
    variance: float
    push: dict[int, Array]
    pushed: dict[int, float]
    release: int = 0
    peak: Array | None = None


def begin_rest(q: float, variance: float, z: Array, tau: float) -> Rest:
    return Rest(q=q, variance=variance, push={-1: z, 1: z}, pushed={-1: -tau, 1: tau})


def continue_rest(rest: Rest, q: float, variance: float, z: Array, tau: float) -> Rest:
    """The rest with one more sample; its place is that at which the joint was known best."""
    if variance < rest.variance:
        rest = replace(rest, q=q, variance=variance)
    for way in (-1, 1):
        if way * tau > rest.pushed[way]:
            rest = replace(rest, push=rest.push | {way: z}, pushed=rest.pushed | {way: way * tau})
    return rest


def remember(rests: tuple[Rest, ...], rest: Rest) -> tuple[Rest, ...]:
    return (*rests, rest)[-_LONGEST:]


def log_exponential(x: float, scale: float, sigma: float) -> float:
    """Log density at x of an exponential of mean `scale` plus Gaussian noise."""
    sigma = max(sigma, 1e-9 * scale)
    return float(exponnorm.logpdf(x, scale / sigma, scale=sigma))


def stop_odds(
    push: float, friction: float, stiction: float, strength: float, sigma: float
) -> float:
    """Log likelihood ratio of an end stop against friction that holds a resting joint.

    Friction holds any push up to the static one, so that all up to there are as likely; a stop
    takes whatever the arm gives.

    Args:
        push: On the joint, beyond its position's own forces.
        friction: Coulomb friction.
        stiction: By how much static friction exceeds it, a share of it: mean of an exponential.
        strength: Mean push of the arm against a stop.
        sigma: Of push minus friction.
    """
    static = friction * (1.0 - stiction * np.log1p(-_QUANTILES))
    edges = norm.cdf(push / sigma) - norm.cdf((push - static) / sigma)
    held = float(np.mean(np.maximum(edges, 0.0) / static))
    stopped = float(np.exp(log_exponential(push, strength, sigma)))
    held = (1.0 - _STRANGE) * held + _STRANGE * stopped
    return float(np.log(max(stopped, 1e-300)) - np.log(max(held, 1e-300)))


def latch_odds(
    excess: float, friction: float, stiction: float, force: float, sigma: float
) -> float:
    """Log likelihood ratio of a latch against static friction, for a push that set it moving.

    Args:
        excess: Of the push over Coulomb friction.
        friction: Coulomb friction.
        stiction: Mean share of it by which static friction exceeds it.
        force: Mean one of latches.
        sigma: Of the excess.
    """
    latched = log_exponential(excess, force, sigma)
    stuck = log_exponential(excess, stiction * friction, sigma)
    stuck = float(np.logaddexp(stuck + np.log1p(-_STRANGE), latched + np.log(_STRANGE)))
    return latched - stuck


def limit_belief(
    way: int,
    rests: list[tuple[Rest, float]],
    bound: tuple[float, float],
    prior: float,
    slack: float,
) -> LimitBelief:
    """One end of the range.

    Args:
        way: -1 for the lower one, 1 for the upper one.
        rests: With the log likelihood ratio of a stop that way.
        bound: How far the joint went that way, and the variance of that.
        prior: Probability that a joint which rests does so at a stop.
        slack: By how much a joint may go on at a stop.
    """

    def passed(rest: Rest) -> bool:
        beyond = way * (bound[0] - rest.q) - slack
        return bool(beyond > 3.0 * np.sqrt(rest.variance + bound[1]))

    last = [(rest, odds) for rest, odds in rests if not passed(rest)]
    if not last:
        return LimitBelief(
            probability=0.0,
            position=float("nan"),
            variance=float("nan"),
            bound=bound[0],
            bound_variance=bound[1],
        )
    rest, odds = max(last, key=lambda one: one[1])
    return LimitBelief(
        probability=float(expit(logit(prior) + odds)),
        position=rest.q,
        variance=rest.variance + slack**2 / 12.0,
        bound=bound[0],
        bound_variance=bound[1],
    )


NO_LATCH = LatchBelief(
    probability=0.0,
    position=float("nan"),
    variance=float("nan"),
    force=float("nan"),
    force_variance=float("nan"),
)
