"""How far a sensor stream can be trusted."""

from dataclasses import dataclass

from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class StreamHealth(Immutable):
    """What a monitor makes of a stream.

    Attributes:
        age: Of the last reading that was passed on, [s].
        fault: What is wrong with the stream, in words; empty while nothing is.
    """

    age: float = 0.0
    fault: str = ""


HEALTHY = StreamHealth()
