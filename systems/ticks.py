"""Durations as numbers of ticks: configurations are in seconds, filters count ticks."""

from maths.validation import require_fields


def whole_ticks(duration: float, period: float) -> int:
    """The number of ticks of `period` [s] that is nearest to `duration` [s]."""
    return round(duration / period)


def require_ticks(
    system: str, config: object, period: float, *, lasting: str, least: int = 1
) -> None:
    """Refuses the first duration that is not so many ticks long.

    Args:
        system: Name of the system, and of the part of its config.
        config: Holds the durations.
        period: Of the ticks, [s]; above zero.
        lasting: Fields by name, in [s].
        least: Number of ticks that each of them needs.
    """
    count = "a tick" if least == 1 else f"{least} ticks"
    require_fields(
        system,
        config,
        lasting.split(),
        f">= {count}, {least * period:.3g} s",
        lambda duration: whole_ticks(duration, period) >= least,
    )
