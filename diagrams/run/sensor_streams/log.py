"""Sensor streams in an MCAP file: what every port gave, tick by tick, written and read back.

A stream is what one port of the station gives. The file's chunks are compressed without loss.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from diagrams.run.sensor_streams.codecs import (
    DEFINITIONS,
    Codec,
    Stamped,
    Topic,
    codec_for,
    definition,
    nanoseconds,
)
from diagrams.run.yaml_schema import ScenarioError, one_line


@dataclass(frozen=True, kw_only=True)
class Stream:
    """What one port gives, and how that is written.

    Attributes:
        port: Its name.
        model: A value like the port's; an array for a vector port.
        topic: Of the messages.
        codec: From values to messages and back.
    """

    port: str
    model: Any
    topic: str
    codec: Codec


def make_streams(models: Mapping[str, Any], topics: Mapping[str, Topic]) -> list[Stream]:
    """A stream for each port, by the type of its value.

    Args:
        models: A value like the port's, by port.
        topics: Of single ports; the others' are called like the port.
    """
    return [
        Stream(
            port=port,
            model=model,
            topic=topics[port].name if port in topics else f"/{port}",
            codec=codec_for(model, topics.get(port)),
        )
        for port, model in models.items()
    ]


class SensorLogWriter:
    """Writes the streams' values tick by tick; the file is at its place once it is closed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._unfinished = path.with_name(f".{os.getpid()}-{path.name}")
        try:
            self._file = self._unfinished.open("wb")
        except OSError as error:
            raise ScenarioError(f"{path}: cannot be written: {one_line(error)}") from None
        self._writer = Writer(self._file)
        self._schemas = {
            name: self._writer.register_msgdef(name, definition(name)) for name in DEFINITIONS
        }

    def write(self, stream: Stream, value: Any, time: float) -> None:
        """Writes the messages of a port's value at `time` [s]."""
        schema = self._schemas[stream.codec.message_type]
        for stamp, message in stream.codec.encode(value, nanoseconds(time)):
            self._writer.write_message(stream.topic, schema, message, log_time=stamp)

    def close(self) -> None:
        try:
            self._writer.finish()
            self._file.close()
            os.replace(self._unfinished, self.path)
        finally:
            self._unfinished.unlink(missing_ok=True)


class SensorLog:
    """A file of sensor streams, read by instants.

    Attributes:
        streams: Those of the known ones that it holds.
        end: Instant of the last message, [s].

    Args:
        path: Of the file.
        known: The streams to look for.

    Raises:
        ScenarioError: if it cannot be read.
    """

    def __init__(self, path: Path, known: list[Stream]) -> None:
        self._path = path
        try:
            self._reader = make_reader(path.open("rb"), decoder_factories=[DecoderFactory()])
            summary = self._reader.get_summary()
        except (OSError, McapError) as error:
            raise ScenarioError(f"{path}: cannot be read: {one_line(error)}") from None
        if summary is None or summary.statistics is None:
            raise ScenarioError(f"{path}: was not written to its end; record it again")
        topics = {channel.topic for channel in summary.channels.values()}
        self.streams = [stream for stream in known if stream.topic in topics]
        self.end = summary.statistics.message_end_time * 1e-9

    def _messages(self, **selection: Any) -> Iterator[tuple[str, Stamped]]:
        for found in self._reader.iter_decoded_messages(**selection):
            yield found.channel.topic, (found.message.log_time, found.decoded_message)

    def read(self, time: float, period: float) -> dict[str, Any]:
        """Every port's value at the tick `time`, from the messages of (time - period, time].

        A stream without a message in a tick keeps its last value; a window is then empty.

        Raises:
            ScenarioError: if a stream that is no window has not begun by then.
        """
        now = nanoseconds(time)
        start = max(0, nanoseconds(time - period) + 1)
        found: dict[str, list[Stamped]] = {stream.topic: [] for stream in self.streams}
        for topic, message in self._messages(starting_at=start, ending_at=now):
            if topic in found:
                found[topic].append(message)
        values = {}
        for stream in self.streams:
            messages = found[stream.topic]
            if not messages and not stream.codec.is_window:
                earlier = self._messages(topics=[stream.topic], ending_at=now, reverse=True)
                messages = [message for _, message in islice(earlier, 1)]
            if not messages and not stream.codec.is_window:
                raise ScenarioError(
                    f"{self._path}: the stream '{stream.port}' begins only after {time:.2f} s"
                )
            values[stream.port] = stream.codec.decode(messages)
        return values


class SensorRecorder(LeafSystem):
    """Writes what flows through its ports at every tick into a file of sensor streams.

    The file lies outside the Context, so one recorder serves one simulation.

    .. pydrake_system::

        name: SensorRecorder
        input_ports:
        - <stream>

    - `<stream>`: each of the streams, as the station has it.

    Args:
        path: The file, replaced where it exists.
        streams: One for each port.
        period: Of the ticks, [s].
    """

    def __init__(self, path: Path, streams: list[Stream], period: float) -> None:
        super().__init__()
        self.log = SensorLogWriter(path)
        self._streams = streams
        for stream in streams:
            if isinstance(stream.model, np.ndarray):
                self.DeclareVectorInputPort(stream.port, len(stream.model))
            else:
                self.DeclareAbstractInputPort(stream.port, AbstractValue.Make(stream.model))
        self.DeclarePeriodicPublishEvent(period, 0.0, self._write)

    def _write(self, context: Context) -> None:
        for stream in self._streams:
            value = self.GetInputPort(stream.port).Eval(context)
            self.log.write(stream, value, context.get_time())


class SensorReplay(LeafSystem):
    """Hands out recorded sensor streams as the station handed out the measurements.

    At the tick t a window holds the samples of (t - period, t], every other port the last value at
    or before t. Between ticks the ports keep the last tick's values.

    .. pydrake_system::

        name: SensorReplay
        output_ports:
        - <stream>

    - `<stream>`: each stream that the file holds, typed like the station's.

    Args:
        log: The streams.
        period: Of the ticks, [s].
    """

    def __init__(self, log: SensorLog, period: float) -> None:
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
