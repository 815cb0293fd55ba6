"""The colours that every picture has, and those of estimators that have none of their own.

They are Paul Tol's, which stay distinct for colour-blind readers. None of those of estimators is a
joint's.
"""

from collections.abc import Mapping

TRUTH = "#222222"
QUIET = "#8C8C8C"  # Grid text, events, what does not move.
PLAN = "#2255EE"  # The way before the hand.
OTHERS = (
    "#4477AA",
    "#EE7733",
    "#009988",
    "#AA3377",
    "#66CCEE",
    "#CCBB44",
    "#882255",
    "#999933",
)


def estimator_color(colors: Mapping[str, str], name: str, index: int) -> str:
    """An estimator's colour; without one, that of the index among those that nobody has."""
    free = [color for color in OTHERS if color not in colors.values()]
    return colors.get(name, free[index % len(free)])


def rgb(color: str) -> tuple[float, float, float]:
    """Red, green and blue, each 0 to 1, of '#RRGGBB'."""
    red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue
