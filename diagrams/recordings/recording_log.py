"""A foreign recording, read by instants like one of our own."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from crossmodal.diagrams.recordings.port_sources import Source
from crossmodal.diagrams.recordings.survey import Survey
from crossmodal.diagrams.run.sensor_streams.codecs import nanoseconds
from crossmodal.diagrams.run.sensor_streams.log import Stream
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.recordings.clock import StampClock
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import Recording, RecordingError, stamp_of

_MOST_LATE = 5.0  # Messages that are logged later than that after their stamp are left out, [s].
_SLACK = 1_000_000  # [ns]


class RecordingLog:
    """The streams of a recording by instants, each message read once, in the order of the file.

    Of what the recording holds, only what may still be measured until the tick in hand is in
    memory: what was logged until then and, where stamps are older than the log, a little more.

    Attributes:
        streams: Those that have a source.
        scenario: Empty: the recording does not say it.
        end: The last instant, [s] since the start.
        interrupted: False: nobody says so.
        start: The first tick, [ns] on the recording's axis.

    Args:
        found: What is in the recording.
        sources: By ports.
        streams: Of all ports that are known.
        start: The first tick, [ns] on the recording's axis.
        end: The last, likewise.
    """

    scenario = ""
    interrupted = False

    def __init__(
        self,
        found: Survey,
        sources: Mapping[str, Source],
        streams: list[Stream],
        start: int,
        end: int,
    ) -> None:
        self._path: Path = found.path
        self._sources = sources
        self.streams = [stream for stream in streams if stream.port in sources]
        self.start = start
        self.end = 1e-9 * (end - start)
        self._by_topic: dict[str, list[Source]] = {}
        for source in sources.values():
            for topic in source.topics:
                self._by_topic.setdefault(topic, []).append(source)
        late = max((found.topics[topic].late for topic in self._by_topic), default=0.0)
        self._late = nanoseconds(min(late, _MOST_LATE)) + _SLACK
        self._messages = self._timed()
        self._next: tuple[int, str, int, Any] | None = next(self._messages, None)

    def _timed(self) -> Iterator[tuple[int, str, int, Any]]:
        """Log time, topic, instant since the start [ns] and message."""
        clocks = {topic: StampClock() for topic in self._by_topic}
        recording: Recording
        with open_recording(self._path) as recording:
            for logged in recording.messages(list(self._by_topic)):
                message = logged.decode()
                time = clocks[logged.topic].time(stamp_of(message), logged.time)
                # A log whose times stand still does not say how far it is.
                yield max(logged.time, time), logged.topic, time - self.start, message

    def read(self, time: float, period: float) -> dict[str, Any]:
        """Every port's value at the tick `time`, from the messages until then.

        Raises:
            ScenarioError: where the recording is damaged, or a stream has not begun by then.
        """
        now = nanoseconds(time)
        try:
            while self._next is not None and self._next[0] - self.start <= now + self._late:
                _, topic, instant, message = self._next
                for source in self._by_topic[topic]:
                    source.add(topic, instant, message)
                self._next = next(self._messages, None)
            values = {port: source.value(now) for port, source in self._sources.items()}
        except RecordingError as error:
            said = str(error)
            where = "" if said.startswith(str(self._path)) else f"{self._path}: at {time:.2f} s: "
            raise ScenarioError(f"{where}{said}") from None
        for port, value in values.items():
            if value is None:
                raise ScenarioError(
                    f"{self._path}: the stream '{port}' begins only after {time:.2f} s; leave it"
                    " out of the map"
                )
        return values
