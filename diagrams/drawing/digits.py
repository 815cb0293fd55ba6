"""Writes values for people: with their unit, and only with digits that mean something."""

import math

_MOST_PLACES = 4  # After the point; what is smaller is written as 0.


def _shows(value: float) -> bool:
    """Whether a value is finite and not written as 0."""
    return math.isfinite(value) and abs(value) >= 0.5 * 10.0**-_MOST_PLACES


def places(value: float, significant: int = 2) -> int:
    """How many places after the point show so many significant digits of a value."""
    if not _shows(value):
        return 0
    exponent = int(f"{value:.{significant - 1}e}".partition("e")[2])
    return min(max(significant - 1 - exponent, 0), _MOST_PLACES)


def fixed(value: float, after: int, *, signed: bool = False) -> str:
    """A value with so many places after the point, no sign before a zero; 'none' if infinite.

    Args:
        signed: With a plus before what is not negative.
    """
    return f"{value:{'+' * signed}z.{after}f}" if math.isfinite(value) else "none"


def written(
    value: float | None,
    unit: str = "",
    *,
    spread: float = math.nan,
    beside: float = math.nan,
    significant: int = 2,
    signed: bool = False,
    of_spread: int = 2,
) -> str:
    """A value with its unit, as '-0.031 mm' or '24.463 ± 0.026 cm'; '-' for one that is not known.

    Args:
        unit: Of all values here.
        spread: Its standard deviation.
        beside: What it stands next to: it gets as many places as two digits of that have.
        significant: Digits of a value that has neither, if it is not a whole number.
        signed: With a plus before what is not negative.
        of_spread: Digits of the standard deviation that are shown.
    """
    if value is None or math.isnan(value):
        return "-"
    value = float(value)
    scale = beside if math.isnan(spread) else spread
    own = 0 if value.is_integer() else places(value, significant)
    after = places(scale, of_spread) if _shows(scale) else own
    text = fixed(value, after, signed=signed)
    if not math.isnan(spread):
        text += f" ± {fixed(spread, after)}"
    return f"{text} {unit}".rstrip()


def written_range(
    low: float, median: float, high: float, unit: str = "", *, error: float = math.nan
) -> str:
    """'median (low to high) unit', as '0.1 (0.0 to 5.1) mm'; 'none' for what is infinite.

    Args:
        error: Standard error of the median. The first digit of it is the last one that is shown,
            but at least one of the median and at most three. Where it is not known, two digits of
            the median and of the width are shown.
    """
    after = max(places(median), places(high - low))
    if _shows(error):
        after = min(max(places(error, 1), places(median, 1)), places(median, 3))
    text, *ends = (fixed(value, after) for value in (median, low, high))
    return f"{text} ({' to '.join(ends)}) {unit}".rstrip()
