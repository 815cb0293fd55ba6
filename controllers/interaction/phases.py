"""The phases of a manipulation."""

from enum import IntEnum


class Phase(IntEnum):
    """In the order in which they follow; a lost grasp leads from a later one back to RELEASE."""

    RELEASE = 0
    APPROACH = 1
    CLOSE = 2
    EXPLORE = 3
    RETURN = 4
    STOP = 5


def is_held(phase: float) -> bool:
    """Whether the hand has closed around something."""
    return phase >= Phase.EXPLORE
