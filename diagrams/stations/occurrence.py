"""What happens in some intervals of an episode and not in others."""

from collections.abc import Iterable

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.scenario import Interval


class Occurrence(LeafSystem):
    """One value while any of the intervals lasts, by default one, and else the other of 0 and 1.

    Output ports:
    - `occurring`: (1,) 1 or 0.
    """

    def __init__(self, intervals: Iterable[Interval], during: float = 1.0) -> None:
        super().__init__()
        intervals = tuple(intervals)

        def occurring(context: Context, output: BasicVector) -> None:
            now = any(context.get_time() in interval for interval in intervals)
            output.SetAtIndex(0, during if now else 1.0 - during)

        self.DeclareVectorOutputPort("occurring", 1, occurring, {self.time_ticket()})
