"""What happens in some intervals of an episode and not in others."""

from collections.abc import Iterable

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.scenario import Interval


def occurs(intervals: Iterable[Interval], time: float) -> float:
    """One if any of the intervals holds a time [s], else zero."""
    return float(any(time in interval for interval in intervals))


class Occurrence(LeafSystem):
    """One while any of the intervals lasts, else zero.

    Output ports:
    - `occurring`: (1,) 1 or 0.
    """

    def __init__(self, intervals: Iterable[Interval]) -> None:
        super().__init__()
        intervals = tuple(intervals)

        def occurring(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, occurs(intervals, context.get_time()))

        self.DeclareVectorOutputPort("occurring", 1, occurring, {self.time_ticket()})
