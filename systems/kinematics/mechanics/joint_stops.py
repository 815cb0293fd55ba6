"""What holds a resting joint more firmly than its friction: an end stop, or a detent.

A joint that rests has been pushed as hard as the hand pushed it. A push that friction cannot hold
means that something else did: an end stop while the joint stays there or turns back, a detent once
it has given way in the direction of the push.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import DetentBelief, LimitBelief

_MOST = 16  # Rests that are remembered.


@dataclass(frozen=True, kw_only=True)
class Rest(Immutable):
    """The joint has stood still.

    Attributes:
        q: Where it was when that was known best, [m or rad].
        variance: Of that.
        pushes: (n, 6) the hand's spatial force when it was hardest along each axis of P, in either
            direction. Which of them pushes the joint is known once its axis is.
        hardest: (6,) those forces, [N], smoothed, which a jolt does not raise; they are behind
            while a push grows.
        release: Direction in which it moved on; 0 while it has not.
    """

    q: float
    variance: float
    pushes: Array
    hardest: Array
    release: int = 0

    def push(self, S: Array, direction: int) -> Array:
        """The force (6,) that pushed hardest along the unit twist S (6,), or against it."""
        return np.asarray(self.pushes[np.argmax(direction * (self.pushes @ S))])


def _by_axis(F: Array) -> Array:
    return np.concatenate([F[3:], -F[3:]])


def begin_rest(q: float, variance: float, F: Array, smoothed: Array) -> Rest:
    """A rest at q, with a force F (6,) of the hand and the same smoothed."""
    return Rest(q=q, variance=variance, pushes=np.tile(F, (6, 1)), hardest=_by_axis(smoothed))


def continue_rest(rest: Rest, F: Array, smoothed: Array) -> Rest:
    """The rest with one more push; see `begin_rest`."""
    now = _by_axis(smoothed)
    harder = now > rest.hardest
    pushes = np.where(harder[:, None], F, rest.pushes)
    return replace(rest, pushes=pushes, hardest=np.maximum(now, rest.hardest))


def pushed_on(rest: Rest, F: Array, S: Array) -> Rest | None:
    """The rest that was left, with a push F (6,) that still grows; None once it does not.

    A hand that bends looks like a joint that moves. What holds the joint lets go when the push is
    hardest.
    """
    grows = rest.release * float(S @ (F - rest.push(S, rest.release))) > 0.0
    return replace(rest, pushes=np.vstack([rest.pushes, F])) if grows else None


def left(rest: Rest, q: float, variance: float) -> bool:
    """Whether the joint is surely elsewhere; the hand that bends looks at first as if it were."""
    return abs(q - rest.q) > 3.0 * float(np.sqrt(variance + rest.variance))


def remember(rests: tuple[Rest, ...], rest: Rest) -> tuple[Rest, ...]:
    """The rests with one more; too many lose the one that was pushed least."""
    rests = (*rests, rest)
    if len(rests) <= _MOST:
        return rests
    least = min(range(len(rests)), key=lambda k: float(rests[k].hardest.max()))
    return rests[:least] + rests[least + 1 :]


@dataclass(frozen=True, kw_only=True)
class Excess:
    """How far a push was beyond Coulomb friction, its variance, and how surely beyond any."""

    force: float
    variance: float
    probability: float


Judge = Callable[[Rest, int], Excess]  # Judges the push of a rest in a direction.


def limit_belief(
    direction: int, rests: Sequence[Rest], bound: tuple[float, float], slack: float, judge: Judge
) -> LimitBelief:
    """One end of the range: a limit where a stop was reached, else how far the joint has been.

    Args:
        direction: -1 for the lower end, 1 for the upper one.
        rests: All so far.
        bound: How far the joint went in that direction, and the variance of that.
        slack: By how much a joint may go on at a stop.
        judge: Of the push at a rest.
    """

    def passed(rest: Rest) -> bool:
        beyond = direction * (bound[0] - rest.q) - slack
        return beyond > 3.0 * float(np.sqrt(rest.variance + bound[1]))

    held = [rest for rest in rests if rest.release != direction and not passed(rest)]
    found = [(judge(rest, direction).probability, rest) for rest in held]
    probability, at = max(found, key=lambda one: one[0], default=(0.0, None))
    return LimitBelief(
        probability=probability,
        position=float("nan") if at is None else at.q,
        variance=float("nan") if at is None else at.variance + slack**2 / 12.0,
        bound=bound[0],
        bound_variance=bound[1],
    )


def detent_belief(rests: Sequence[Rest], judge: Judge) -> DetentBelief:
    """The likeliest of the rests that gave way to more than friction."""
    best = DetentBelief()
    for rest in rests:
        if rest.release == 0:
            continue
        excess = judge(rest, rest.release)
        if excess.probability > best.probability:
            best = DetentBelief(
                probability=excess.probability,
                position=rest.q,
                variance=rest.variance,
                force=excess.force,
                force_variance=excess.variance,
            )
    return best
