"""What happens in some intervals of an episode and not in others."""

from collections.abc import Callable, Iterable
from typing import TypeVar

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.scenario import Interval

Span = TypeVar("Span", bound=Interval)


class Occurrence(LeafSystem):
    """A value while any of the intervals lasts, the least of theirs, and else another one.

    Output ports:
    - `occurring`: (1,) by default 1 while one lasts and 0 else.
    """

    def __init__(
        self,
        intervals: Iterable[Span],
        during: Callable[[Span], float] = lambda _: 1.0,
        otherwise: float = 0.0,
    ) -> None:
        super().__init__()
        intervals = tuple(intervals)

        def occurring(context: Context, output: BasicVector) -> None:
            now = (during(interval) for interval in intervals if context.get_time() in interval)
            output.SetAtIndex(0, min(now, default=otherwise))

        self.DeclareVectorOutputPort("occurring", 1, occurring, {self.time_ticket()})
