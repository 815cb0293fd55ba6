"""Sensor streams in an MCAP file: what every port gave, tick by tick, written and read back.

A stream is what one port of the station gives. The file's chunks are compressed without loss. A
record of metadata says what the streams are of: the scenario, and how long the episode was.
"""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mcap.reader import make_reader
from mcap.summary import Summary
from mcap_ros2.decoder import DecoderFactory
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.calibration import Calibration, CameraCalibration
from crossmodal.diagrams.run.recorder import declare_input
from crossmodal.diagrams.run.sensor_streams.codecs import (
    CAMERA_POSE,
    Codec,
    Stamped,
    Topic,
    codec_for,
    nanoseconds,
)
from crossmodal.diagrams.run.sensor_streams.mcap_file import McapFile
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import StampedImage
from crossmodal.systems.recordings.mcap_check import check_mcap
from crossmodal.systems.recordings.ros_messages import made

_METADATA = "episode"
_SILENCE = 3600.0  # At most, from the last message to the episode's end, [s].


@dataclass(frozen=True, kw_only=True)
class Stream:
    """What one port gives, and how that is written.

    Attributes:
        port: Its name.
        model: A value like the port's; an array for a vector port.
        topic: Of the messages.
        codec: From values to messages and back.
        camera: Of stamped images: what is believed of their camera; None if it is not known.
    """

    port: str
    model: Any
    topic: str
    codec: Codec
    camera: CameraCalibration | None = None

    @property
    def pose_topic(self) -> str:
        """The topic that says where a camera is that moves; empty for all other streams."""
        moves = self.camera is not None and not self.camera.is_fixed
        return f"{self.topic}/pose" if moves else ""

    @property
    def parts(self) -> list[tuple[str, Codec]]:
        """The topics into which a value is written, with their codecs."""
        pose = [(self.pose_topic, CAMERA_POSE)] if self.pose_topic else []
        return [(self.topic, self.codec), *pose]


def make_streams(
    models: Mapping[str, Any],
    topics: Mapping[str, Topic],
    calibration: Calibration | None = None,
) -> list[Stream]:
    """A stream for each port, by the type of its value.

    Args:
        models: A value like the port's, by port.
        topics: Of single ports; the others' are called like the port.
        calibration: What is believed of the cameras; by default there is none.
    """
    believed = calibration or Calibration()
    return [
        Stream(
            port=port,
            model=model,
            topic=topics[port].name if port in topics else f"/{port}",
            codec=codec_for(model, topics.get(port)),
            camera=believed.camera_of(port) if isinstance(model, StampedImage) else None,
        )
        for port, model in models.items()
    ]


class StreamLog(Protocol):
    """Recorded streams that are read by instants, of our own or of a foreign recording.

    `start` is the instant of the first tick by the recording's own clock, [ns].
    """

    start: int
    streams: list[Stream]
    scenario: str
    end: float
    interrupted: bool

    def read(self, time: float, period: float) -> dict[str, Any]:
        """Every port's value at the tick `time`, see `SensorLog.read`."""


class SensorLogWriter:
    """Writes the streams' values tick by tick; the file is at its place once it is closed.

    Where the disk is full, or cannot be written any more, the file is given up.

    Attributes:
        path: Of the file.
        failure: Why there will be none, in one line; empty while there is no reason.

    Args:
        scenario: What the streams are of, as text.
    """

    def __init__(self, path: Path, scenario: str = "") -> None:
        self.path = path
        self.failure = ""
        self._scenario = scenario
        self._file = McapFile(path)

    def write(self, stream: Stream, value: Any, time: float) -> None:
        """Writes the messages of a port's value at `time` [s]."""
        if self.failure:
            return
        try:
            for topic, codec in stream.parts:
                for stamp, fields in codec.encode(value, nanoseconds(time)):
                    self._file.write(topic, made(codec.message_type, fields), stamp)
        except OSError as error:
            self._give_up(error)

    def close(self, duration: float | None = None, *, interrupted: bool = False) -> None:
        """Finishes the file.

        Args:
            duration: Of the episode, [s]; None leaves that to the last message.
            interrupted: Whether the episode did not come to its end.
        """
        if self.failure:
            return
        facts = {"scenario": self._scenario} if self._scenario else {}
        if duration is not None:
            facts["duration"] = repr(duration)
        if interrupted:
            facts["interrupted"] = "yes"
        try:
            if facts:
                self._file.describe(_METADATA, facts)
            self._file.close()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.failure = f"{self.path}: cannot be written: {one_line(error.strerror or error)}"
        self._file.discard()  # What is left of the disk is for the results.


class SensorLog:
    """A file of sensor streams, read by instants.

    Attributes:
        streams: Those of the known ones that it holds.
        scenario: What they are of, as text; empty where the file does not say it.
        end: Of the episode or, where the file does not say it, the last message's instant, [s].
        interrupted: Whether the file says that the episode did not come to its end.
        start: Zero: the clock is that of the episode.

    Args:
        known: The streams to look for.

    Raises:
        ScenarioError: if it cannot be read.
    """

    start = 0

    def __init__(self, path: Path, known: list[Stream]) -> None:
        self._path = path
        # The instant [ns] that was read last, and all values then.
        self._read_until, self._values = -1, dict[str, Any]()
        with self._damage_told("cannot be read"):
            if os.path.exists(path) and not os.path.isfile(
                path
            ):  # Nobody may ever write to a pipe.
                raise ValueError("it is no file")
            self._reader = make_reader(
                path.open("rb"), validate_crcs=True, decoder_factories=[DecoderFactory()]
            )
            summary = self._reader.get_summary()
            if summary is None or summary.statistics is None:
                raise ValueError("it was not written to its end; record it again")
        with self._damage_told("is damaged"):
            check_mcap(path)
        with self._damage_told("cannot be read"):
            self.streams = self._held(summary, known)
            facts = next((m for m in self._reader.iter_metadata() if m.name == _METADATA), None)
            said = {} if facts is None else facts.metadata
            self.scenario = said.get("scenario", "")
            self.interrupted = "interrupted" in said
            last = summary.statistics.message_end_time * 1e-9
            self.end = float(said.get("duration", last))
            if not 0.0 <= self.end <= last + _SILENCE:
                raise ValueError(
                    f"it says that it ends at {self.end:g} s, but its last message is of {last:g} s"
                )

    @contextlib.contextmanager
    def _damage_told(self, what: str) -> Iterator[None]:
        """Turns whatever the library makes of a damaged file into one line."""
        try:
            yield
        except Exception as error:
            said = one_line(error) or type(error).__name__
            raise ScenarioError(f"{self._path}: {what}: {said}") from None

    def _held(self, summary: Summary, known: list[Stream]) -> list[Stream]:
        """Those of the known streams that have messages, of the type that they are to have."""
        counts = summary.statistics.channel_message_counts if summary.statistics else {}
        types = {
            channel.topic: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
            if counts.get(channel.id)
        }
        held = [stream for stream in known if stream.topic in types]
        for topic, codec in (part for stream in held for part in stream.parts):
            found, expected = types.get(topic, codec.message_type), codec.message_type
            if found != expected:
                raise ValueError(f"'{topic}' holds {found}, but {expected} is expected")
        return held

    def _messages(self, **selection: Any) -> Iterator[tuple[str, Stamped]]:
        with self._damage_told("is damaged"):
            for found in self._reader.iter_decoded_messages(**selection):
                yield found.channel.topic, (found.message.log_time, found.decoded_message)

    def read(self, time: float, period: float) -> dict[str, Any]:
        """Every port's value at the tick `time`, from the messages of (time - period, time].

        A stream without a message in a tick keeps its last value; a window is then empty. Values
        that are no numbers are handed on: a sensor says by them that it has measured nothing.
        A camera that is fixed in the world is where its calibration says. One that moves is where
        the recording says; it is not known where in a recording that does not.

        Raises:
            ScenarioError: if a stream that is no window has not begun by then, or a message holds
                no value like its port's.
        """
        now = nanoseconds(time)
        start = max(0, nanoseconds(time - period) + 1)
        follows = self._values and start <= self._read_until + 1 <= now + 1
        found: dict[str, list[Stamped]] = {
            topic: [] for stream in self.streams for topic, _ in stream.parts
        }
        for topic, message in self._messages(starting_at=start, ending_at=now):
            if topic in found:
                found[topic].append(message)
        values = {}
        for stream in self.streams:
            messages = found[stream.topic]
            nothing_new = not any(found[topic] for topic, _ in stream.parts)
            if follows and nothing_new and not stream.codec.is_window:
                values[stream.port] = self._values[stream.port]
                continue
            if not messages and not stream.codec.is_window:
                messages = self._last(stream.topic, now)
            if not messages and not stream.codec.is_window:
                raise ScenarioError(
                    f"{self._path}: the stream '{stream.port}' begins only after {time:.2f} s"
                )
            with self._damage_told(f"'{stream.topic}' at {time:.2f} s"):
                values[stream.port] = stream.codec.decode(messages)
            if stream.pose_topic:
                messages = found[stream.pose_topic] or self._last(stream.pose_topic, now)
                with self._damage_told(f"'{stream.pose_topic}' at {time:.2f} s"):
                    values[stream.port] = _placed(values[stream.port], messages)
            elif stream.camera is not None:
                camera = stream.camera
                X_WC, covariance = camera.X_PC.GetAsMatrix4(), camera.pose_covariance
                values[stream.port] = replace(values[stream.port], X_WC=X_WC, covariance=covariance)
        self._read_until, self._values = now, values
        return values

    def _last(self, topic: str, now: int) -> list[Stamped]:
        """The last message of a topic until an instant [ns]; none if it has not begun by then."""
        earlier = self._messages(topics=[topic], ending_at=now, reverse=True)
        return [message for _, message in islice(earlier, 1)]


def _placed(image: StampedImage, messages: list[Stamped]) -> StampedImage:
    """An image of a camera that is where the last message says, if there is one."""
    if not messages:
        return image
    X_WC, covariance = CAMERA_POSE.decode(messages)
    return replace(image, X_WC=X_WC, covariance=covariance)


class SensorRecorder(LeafSystem):
    """Writes what flows through its ports at every tick into a file of sensor streams.

    A port's value that is the very object of the last tick, and is never written again, is not
    repeated: it is read as the last one. So a large measurement that comes seldom is kept once.

    The file lies outside the Context, so one recorder serves one simulation.

    Input ports:
    - `<stream>`: each of the streams, as the station has it.

    Args:
        path: The file, replaced where it exists.
        streams: One for each port.
        period: Of the ticks, [s].
        scenario: What the streams are of, as text.
    """

    def __init__(
        self, path: Path, streams: list[Stream], period: float, scenario: str = ""
    ) -> None:
        super().__init__()
        self.log = SensorLogWriter(path, scenario)
        self._streams = [(one, declare_input(self, one.port, one.model)) for one in streams]
        self._last: dict[str, Any] = {}
        self.DeclarePeriodicPublishEvent(period, 0.0, self._write)

    def _write(self, context: Context) -> None:
        for stream, port in self._streams:
            value = port.Eval(context)
            if isinstance(value, Immutable) and value is self._last.get(stream.port):
                continue
            self._last[stream.port] = value
            self.log.write(stream, value, context.get_time())


class SensorReplay(LeafSystem):
    """Hands out recorded sensor streams as the station handed out the measurements.

    At the tick t a window holds the samples of (t - period, t], every other port the last value at
    or before t. Between ticks the ports keep the last tick's values.

    Output ports:
    - `<stream>`: each stream that the file holds, typed like the station's.

    Args:
        log: The streams.
        period: Of the ticks, [s].
    """

    def __init__(self, log: StreamLog, period: float) -> None:
        super().__init__()
        self._log = log
        self._period = period
        self._read_tick = -1
        self._values: dict[str, Any] = {}
        for stream in log.streams:
            write, model = self._writer(stream.port), stream.model
            if isinstance(model, np.ndarray):
                self.DeclareVectorOutputPort(stream.port, len(model), write, {self.time_ticket()})
            else:
                self.DeclareAbstractOutputPort(
                    stream.port,
                    lambda model=model: AbstractValue.Make(model),
                    write,
                    {self.time_ticket()},
                )

    def _writer(self, port: str) -> Callable[[Context, Any], None]:
        def write(context: Context, output: BasicVector | AbstractValue) -> None:
            output.set_value(self._at(context.get_time())[port])

        return write

    def _at(self, time: float) -> dict[str, Any]:
        """All values at the last tick, read from the file once for all ports."""
        tick = int(time / self._period + 1e-6)
        if tick != self._read_tick:
            self._values = self._log.read(tick * self._period, self._period)
            self._read_tick = tick
        return self._values
