"""What happens in some intervals of an episode and not in others."""

from collections.abc import Callable, Iterable
from typing import TypeVar

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.scenario import Interval

Span = TypeVar("Span", bound=Interval)


class Occurrence(LeafSystem):
    """A value while any of the intervals lasts, the least of theirs, and else another one.

    Input ports:
    - `by_hand`: (1,) a value that a person sets; of it and the intervals' the one that is farther
      from what there is otherwise counts. May stay unconnected.

    Output ports:
    - `occurring`: (1,) by default 1 while one lasts and 0 else.

    Args:
        intervals: When it happens.
        during: The value of an interval.
        otherwise: The value while none lasts.
    """

    def __init__(
        self,
        intervals: Iterable[Span],
        during: Callable[[Span], float] = lambda _: 1.0,
        otherwise: float = 0.0,
    ) -> None:
        super().__init__()
        intervals = tuple(intervals)
        by_hand = self.DeclareVectorInputPort("by_hand", 1)

        def occurring(context: Context, output: BasicVector) -> None:
            now = [during(interval) for interval in intervals if context.get_time() in interval]
            values = [min(now, default=otherwise)]
            if by_hand.HasValue(context):
                values.append(float(by_hand.Eval(context)[0]))
            output.SetAtIndex(0, max(values, key=lambda value: abs(value - otherwise)))

        self.DeclareVectorOutputPort(
            "occurring", 1, occurring, {self.time_ticket(), by_hand.ticket()}
        )
