"""What happens in an episode, as lines of text on the page."""

from collections.abc import Sequence

from crossmodal.diagrams.drawing.legend import EventBoard
from crossmodal.diagrams.run.record import Event
from crossmodal.diagrams.run.recorder import EpisodeRecorder
from crossmodal.diagrams.run.scenario import Interval
from crossmodal.systems.port_values import StreamHealth

_LINES = 7  # The newest events that are shown.


class EventText:
    """Shows the newest events of an episode: phases, disturbances, reported faults.

    Args:
        board: Where they are shown.
        recorder: Knows what the robot does and what the estimators report.
        spans: What goes wrong by the scenario, in words, and when.
        title: The line above them.
    """

    def __init__(
        self,
        board: EventBoard,
        recorder: EpisodeRecorder,
        spans: Sequence[tuple[str, Interval]],
        title: str,
    ) -> None:
        self._board, self._recorder, self._title = board, recorder, title
        begins = [Event(time=span.start, name=name) for name, span in spans]
        ends = [Event(time=span.end, name=f"{name}: over") for name, span in spans]
        self._planned = sorted([*begins, *ends], key=lambda event: event.time)
        self._read = 0  # Of the recorder's events.
        self._faults: dict[str, str] = {}  # Of each stream.
        self._events: list[Event] = []

    def begin(self) -> None:
        """Shows the title."""
        self._show([], 0.0)

    def update(self, time: float) -> None:
        """Adds what has happened until `time` [s] and shows it."""
        new = self._recorder.events[self._read :]
        self._read += len(new)
        while self._planned and self._planned[0].time <= time:
            new.append(self._planned.pop(0))
        new += self._changed_faults()
        if new:
            self._show(new, time)

    def add(self, event: Event) -> None:
        """Shows what nobody else says at its time."""
        self._show([event], event.time)

    def _show(self, new: Sequence[Event], time: float) -> None:
        self._events = sorted([*self._events, *new], key=lambda event: event.time)[-_LINES:]
        lines = [f"{event.time:6.1f} s  {event.name}" for event in self._events]
        self._board.show([self._title, *lines], time)

    def _changed_faults(self) -> list[Event]:
        """What is reported of the sensor streams now and was not before, of each stream once."""
        now: dict[str, tuple[float, str]] = {}
        for record in self._recorder.estimators.values():
            for tick in record.ticks[-1:]:
                for port, value in tick.values.items():
                    if isinstance(value, StreamHealth) and not now.get(port, (0.0, ""))[1]:
                        now[port] = tick.time, value.fault
        events = []
        for port, (time, fault) in now.items():
            before = self._faults.get(port, "")
            if fault != before:
                stream = port.removesuffix("_health_latest")
                events.append(Event(time=time, name=f"{stream}: {fault or f'no more {before}'}"))
            self._faults[port] = fault
        return events
