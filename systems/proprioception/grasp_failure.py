"""Whether the body still goes where the hand goes: evidence over displacement, not over time.

A handle that shifts in the fingers contradicts every grasp for some ticks, and a slow body moves
hardly more within a tick than one that nobody holds. What tells a lost body from one that shifts is
whether it has come along once the hand has gone some distance.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import log_likelihood
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import PoseBelief


@dataclass(kw_only=True)
class GraspFailureConfig:
    # Probability of a failed grasp when the hand closes.
    prior: float = number(0.03, above=0.0, below=1.0)
    # Displacement of the hand after which the comparison begins anew.
    displacement: float = number(0.05, above=0.0, at_most=10.0, unit="m")
    # Displacement by which the hand pushes a body it does not hold, 1 sigma.
    rest: float = number(7.0e-3, at_least=1e-9, at_most=10.0, unit="m")
    # Shift of a held body per displacement of the hand, 1 sigma.
    shift: float = number(0.3, at_least=0.0, at_most=10.0)
    # Largest log odds that are remembered from one comparison to the next.
    limit: float = number(5.0, above=0.0, at_most=1000.0, unit="nat")
    # Probability from which a failed grasp stays one until the hand opens, where nobody sees it.
    certain: float = number(0.95, at_least=0.5, below=1.0)


@dataclass(kw_only=True)
class GraspFailure:
    """Log odds that the grasp has failed; never written after it is made.

    Attributes:
        X_WH: The bent hand (4, 4) when the comparison began.
        body: The body then, as vision saw it.
        remembered: Log odds then, beside the prior's, [nat].
        now: Log odds now, beside the prior's, [nat].
    """

    X_WH: Array
    body: PoseBelief
    remembered: float = 0.0
    now: float = 0.0

    def probability(self, config: GraspFailureConfig, slip_odds: float = 0.0) -> float:
        """That the grasp has failed, with what pressures and load say of it, [nat]."""
        odds = np.log(config.prior / (1.0 - config.prior)) + self.now + slip_odds
        return float(1.0 / (1.0 + np.exp(-odds)))


def unseen(failure: GraspFailure, config: GraspFailureConfig) -> GraspFailure:
    """The odds at a tick at which vision does not see the body: what it saw counts only so much."""
    return replace(failure, now=float(np.clip(failure.now, -config.limit, config.limit)))


def position_covariance(body: PoseBelief, p_WP: Array) -> Array:
    """Covariance (3, 3) in W of a point of the body that is at p_WP (3,)."""
    J = np.hstack([-se3.skew(p_WP - body.X[:3, 3]) @ body.X[:3, :3], body.X[:3, :3]])
    return np.asarray(J @ body.covariance @ J.T)


def compare(
    failure: GraspFailure, X_WH: Array, body: PoseBelief, p_HA: Array, config: GraspFailureConfig
) -> GraspFailure:
    """The odds after a tick at which vision sees the body.

    Args:
        failure: Of the last such tick.
        X_WH: The bent hand (4, 4).
        body: As vision alone sees it.
        p_HA: The handle in the hand (3,), [m].
    """
    before = failure.X_WH[:3, :3] @ p_HA + failure.X_WH[:3, 3]
    hand_displacement = X_WH[:3, :3] @ p_HA + X_WH[:3, 3] - before
    moved = body.X @ se3.inverse(failure.body.X)
    body_displacement = moved[:3, :3] @ before + moved[:3, 3] - before
    lost = position_covariance(body, before + body_displacement)
    lost += position_covariance(failure.body, before) + config.rest**2 * np.eye(3)
    held = lost + (config.shift * np.linalg.norm(hand_displacement)) ** 2 * np.eye(3)
    odds = log_likelihood(body_displacement, lost) - log_likelihood(
        body_displacement - hand_displacement, held
    )
    now = float(failure.remembered + odds)
    if np.linalg.norm(hand_displacement) < config.displacement:
        return replace(failure, now=now)
    remembered = float(np.clip(now, -config.limit, config.limit))
    return GraspFailure(X_WH=X_WH, body=body, remembered=remembered, now=remembered)
