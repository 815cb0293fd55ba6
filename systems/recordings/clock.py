"""Stamps of clocks that are set, wrap around or belong to another computer, on one time axis."""

from dataclasses import dataclass, field

# Stamps that differ more from when they were logged are another clock's, [ns].
_APART = 1_000_000_000


@dataclass(kw_only=True)
class StampClock:
    """Brings the stamps of one topic onto the axis of the log's times.

    A stamp says more exactly than the log when something was measured, so it counts, as long as the
    two differ as they did. Where they do not, the clock that stamps is another computer's, was set
    or has wrapped around: its offset is then that of the first message after it. A log whose times
    stand still, as some converters write them, is not believed.

    Attributes:
        jumps: How often the clock was set.
        offset: Of the stamps against the axis, [ns].
        apart: Stamps that differ more from when they were logged are of another clock, [ns].
    """

    jumps: int = 0
    offset: int = 0
    apart: int = _APART
    _last: tuple[int, int] | None = field(default=None, repr=False)

    def time(self, stamp: int, logged: int) -> int:
        """When a message was stamped, on the log's axis, [ns].

        Args:
            stamp: In its header; zero where there is none.
            logged: When it was logged.
        """
        last, self._last = self._last, (stamp, logged)
        if not stamp:
            return logged
        if last is not None and logged == last[1]:
            return stamp - self.offset
        if abs(stamp - self.offset - logged) > self.apart:
            moved = last is not None and last[0] != 0
            self.jumps += moved
            self.offset = stamp - logged
        return stamp - self.offset
