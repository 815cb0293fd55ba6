"""The network's tick: who has its period, and durations as numbers of ticks."""

from operator import attrgetter

from crossmodal.maths.validation import number, require

NETWORK_PERIOD = 1.0 / 15.0  # Of the network's ticks unless a scenario says otherwise, [s].


def tick_period() -> float:
    """A configuration's field for the network's period, where that is chosen."""
    return number(NETWORK_PERIOD, at_least=1e-3, at_most=1.0, unit="s")


class Ticked:
    """A configuration of what is updated at the network's ticks.

    Their period is no field of it: all filters share one, see `shared_settings`.

    Attributes:
        period: Of the ticks, [s].
    """

    period = NETWORK_PERIOD


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
