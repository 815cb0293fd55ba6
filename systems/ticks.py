"""Durations as numbers of ticks: configurations are in seconds, filters count ticks."""

from operator import attrgetter

from crossmodal.maths.validation import number, require


def tick_period() -> float:
    """A configuration's field for the period of the network's ticks, 1/15 s by default."""
    return number(1.0 / 15.0, at_least=1e-3, at_most=1.0, unit="s")


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
