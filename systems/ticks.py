"""The network's tick: who gets its period, and durations as numbers of ticks."""

import copy
from dataclasses import fields
from operator import attrgetter
from typing import TypeVar

from crossmodal.maths.validation import number, require

C = TypeVar("C")

NETWORK_PERIOD = 1.0 / 15.0  # Of the network's ticks unless a scenario says otherwise, [s].


def tick_period() -> float:
    """A configuration's field for the network's period, where that is chosen."""
    return number(NETWORK_PERIOD, at_least=1e-3, at_most=1.0, unit="s")


class Ticked:
    """A configuration of what is updated at the network's ticks.

    Their period is no field of it: all filters share one, which `at_period` hands to them.

    Attributes:
        period: Of the ticks, [s].
    """

    period = NETWORK_PERIOD


def at_period(config: C, period: float) -> C:
    """A copy of a dataclass in which each `Ticked` part has the network's period [s]."""
    ticked = copy.copy(config)
    for item in fields(config):  # type: ignore[arg-type]
        part = getattr(config, item.name)
        if isinstance(part, Ticked):
            setattr(ticked, item.name, at_period(part, period))
    if isinstance(ticked, Ticked):
        ticked.period = period
    return ticked


def whole_ticks(duration: float, period: float) -> int:
    """The number of ticks of `period` [s] that is nearest to `duration` [s]."""
    return round(duration / period)


def require_ticks(
    system: str, config: object, period: float, *, lasting: str, least: int = 1
) -> None:
    """Refuses the first duration that is not so many ticks long.

    Args:
        system: Name of the system.
        config: Of the system; its durations are finite.
        period: Of the ticks, [s]; above zero.
        lasting: Fields by name, in [s]; a path `part.field` for those of a part.
        least: Number of ticks that each of them needs.
    """
    count = "a tick" if least == 1 else f"{least} ticks"
    for field in lasting.split():
        enough = whole_ticks(attrgetter(field)(config), period) >= least
        require(enough, system, config, field, f">= {count}, {least * period:.3g} s")
