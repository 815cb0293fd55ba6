"""Sensor streams as ROS 2 messages in an MCAP file: what is written, and how it is read back.

A stream is what one port hands to the network. Its messages are stamped with the instants at which
its values were measured. Values survive exactly; the file's chunks are compressed without loss.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from diagrams.run.yaml_schema import ScenarioError, one_line
from maths.arrays import Array
from systems.port_values import SampleWindow

Stamped = tuple[int, Any]  # Instant [ns] and message.

_TIME = "builtin_interfaces/Time", "int32 sec\nuint32 nanosec"
_HEADER = "std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"
_VECTOR = "geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"
_DEFINITIONS = {
    "sensor_msgs/msg/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
        "uint8 is_bigendian\nuint32 step\nuint8[] data",
        (_HEADER, _TIME),
    ),
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort",
        (_HEADER, _TIME),
    ),
    "geometry_msgs/msg/WrenchStamped": (
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
        (
            _HEADER,
            _TIME,
            ("geometry_msgs/Wrench", "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque"),
            _VECTOR,
        ),
    ),
    "geometry_msgs/msg/PoseStamped": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose",
        (
            _HEADER,
            _TIME,
            (
                "geometry_msgs/Pose",
                "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
            ),
            ("geometry_msgs/Point", _VECTOR[1]),
            ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
        ),
    ),
    "std_msgs/msg/Float64MultiArray": (
        "std_msgs/MultiArrayLayout layout\nfloat64[] data",
        (
            (
                "std_msgs/MultiArrayLayout",
                "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
            ),
            ("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride"),
        ),
    ),
    "std_msgs/msg/Float64": ("float64 data", ()),
}


def definition(message_type: str) -> str:
    """The text of a message's definition with those that it contains."""
    own, parts = _DEFINITIONS[message_type]
    return "\n".join([own, *(f"{'=' * 80}\nMSG: {name}\n{text}" for name, text in parts)])


def nanoseconds(time: float) -> int:
    return round(time * 1e9)


def _header(stamp: int) -> dict[str, Any]:
    seconds, rest = divmod(stamp, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": ""}


@dataclass(frozen=True, kw_only=True)
class Stream:
    """How the values of one port become messages of one topic, and back.

    Attributes:
        port: Name of the output port.
        topic: Of the messages.
        message_type: A key of the definitions.
        model: Makes a value like the port's; None for a vector of one number.
        encode: Messages of a value at an instant [ns].
        decode: The value of the messages since the last tick; the last counts unless all do.
    """

    port: str
    topic: str
    message_type: str
    model: Callable[[], AbstractValue] | None
    encode: Callable[[Any, int], list[Stamped]]
    decode: Callable[[Sequence[Stamped]], Any]


def _image(port: str, topic: str, kind: Any, encoding: str, dtype: type) -> Stream:
    def encode(value: Any, now: int) -> list[Stamped]:
        data = np.asarray(value.data)
        message = {
            "header": _header(now),
            "height": data.shape[0],
            "width": data.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": data.strides[0],
            "data": data.tobytes(),
        }
        return [(now, message)]

    def decode(messages: Sequence[Stamped]) -> Any:
        message = messages[-1][1]
        image = kind(message.width, message.height)
        shape = image.mutable_data.shape
        image.mutable_data[:] = np.frombuffer(message.data, dtype=dtype).reshape(shape)
        return image

    return Stream(
        port=port,
        topic=topic,
        message_type="sensor_msgs/msg/Image",
        model=lambda: Value(kind()),
        encode=encode,
        decode=decode,
    )


def _window(
    port: str,
    topic: str,
    message_type: str,
    size: int,
    to_fields: Callable[[Array], dict[str, Any]],
    to_values: Callable[[Any], list[float]],
    header: bool = True,
) -> Stream:
    def encode(window: Any, now: int) -> list[Stamped]:
        stamps = [nanoseconds(time) for time in window.times]
        return [
            (stamp, ({"header": _header(stamp)} if header else {}) | to_fields(row))
            for stamp, row in zip(stamps, window.values, strict=True)
        ]

    def decode(messages: Sequence[Stamped]) -> Any:
        return SampleWindow(
            times=np.array([stamp * 1e-9 for stamp, _ in messages]),
            values=np.array([to_values(m) for _, m in messages]).reshape(-1, size),
        )

    return Stream(
        port=port,
        topic=topic,
        message_type=message_type,
        model=lambda: AbstractValue.Make(
            SampleWindow(times=np.empty(0), values=np.empty((0, size)))
        ),
        encode=encode,
        decode=decode,
    )


def _number(port: str, topic: str) -> Stream:
    return Stream(
        port=port,
        topic=topic,
        message_type="std_msgs/msg/Float64",
        model=None,
        encode=lambda value, now: [(now, {"data": float(value[0])})],
        decode=lambda messages: [messages[-1][1].data],
    )


def _pose(port: str, topic: str) -> Stream:
    def encode(X: RigidTransform, now: int) -> list[Stamped]:
        q = X.rotation().ToQuaternion()
        position = dict(zip("xyz", map(float, X.translation()), strict=True))
        orientation = {"x": q.x(), "y": q.y(), "z": q.z(), "w": q.w()}
        pose = {"position": position, "orientation": orientation}
        return [(now, {"header": _header(now), "pose": pose})]

    def decode(messages: Sequence[Stamped]) -> RigidTransform:
        pose = messages[-1][1].pose
        q, p = pose.orientation, pose.position
        wxyz = np.array([q.w, q.x, q.y, q.z])
        return RigidTransform(Quaternion(wxyz / np.linalg.norm(wxyz)), [p.x, p.y, p.z])

    return Stream(
        port=port,
        topic=topic,
        message_type="geometry_msgs/msg/PoseStamped",
        model=lambda: Value(RigidTransform()),
        encode=encode,
        decode=decode,
    )


def _wrench_fields(row: Array) -> dict[str, Any]:
    torque, force = (dict(zip("xyz", map(float, part), strict=True)) for part in (row[:3], row[3:]))
    return {"wrench": {"force": force, "torque": torque}}


def _wrench_values(message: Any) -> list[float]:
    torque, force = message.wrench.torque, message.wrench.force
    return [torque.x, torque.y, torque.z, force.x, force.y, force.z]


def _joint_fields(row: Array) -> dict[str, Any]:
    half = len(row) // 2
    position, velocity = row[:half].tolist(), row[half:].tolist()
    return {"name": [], "position": position, "velocity": velocity, "effort": []}


WINDOWS = (
    _window(
        "joint_state_window",
        "/joint_states",
        "sensor_msgs/msg/JointState",
        14,
        _joint_fields,
        lambda message: [*message.position, *message.velocity],
    ),
    _window(
        "wrench_window",
        "/wrist/wrench",
        "geometry_msgs/msg/WrenchStamped",
        6,
        _wrench_fields,
        _wrench_values,
    ),
    _window(
        "pressure_window",
        "/hand/pressures",
        "std_msgs/msg/Float64MultiArray",
        4,
        lambda row: {"layout": {"dim": [], "data_offset": 0}, "data": row.tolist()},
        lambda message: list(message.data),
        header=False,
    ),
)
# What a reader between two messages takes the last one of.
HELD = (
    _image("color_measured", "/camera/color/image_raw", ImageRgba8U, "rgba8", np.uint8),
    _image("depth_measured", "/camera/depth/image_raw", ImageDepth32F, "32FC1", np.float32),
    _image("robot_mask", "/camera/robot_mask", ImageGrey8U, "mono8", np.uint8),
    _number("interaction_active", "/hand/interaction_active"),
    _number("cheat_configuration", "/cheat/configuration"),
    _pose("cheat_body_pose", "/cheat/body_pose"),
)
# All that a network hears, by the station's port, and the truth for the evaluation of a replay.
STREAMS = {stream.port: stream for stream in (*WINDOWS, *HELD)}


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
            name: self._writer.register_msgdef(name, definition(name)) for name in _DEFINITIONS
        }

    def write(self, stream: Stream, value: Any, time: float) -> None:
        """Writes the messages of a port's value at `time` [s]."""
        schema = self._schemas[stream.message_type]
        for stamp, message in stream.encode(value, nanoseconds(time)):
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
        ports: The ports whose streams it holds.
        end: Instant of the last message, [s].

    Raises:
        ScenarioError: if it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._reader = make_reader(path.open("rb"), decoder_factories=[DecoderFactory()])
            summary = self._reader.get_summary()
        except (OSError, McapError) as error:
            raise ScenarioError(f"{path}: cannot be read: {one_line(error)}") from None
        if summary is None or summary.statistics is None:
            raise ScenarioError(f"{path}: was not written to its end; record it again")
        topics = {channel.topic for channel in summary.channels.values()}
        self.ports = [port for port, stream in STREAMS.items() if stream.topic in topics]
        self.end = summary.statistics.message_end_time * 1e-9

    def _messages(self, **selection: Any) -> Iterator[tuple[str, Stamped]]:
        for found in self._reader.iter_decoded_messages(**selection):
            yield found.channel.topic, (found.message.log_time, found.decoded_message)

    def read(self, time: float, period: float) -> dict[str, Any]:
        """Every port's value at the tick `time`, from the messages of (time - period, time].

        A stream without a message in a tick keeps its last value; a window is then empty.
        """
        now = nanoseconds(time)
        start = max(0, nanoseconds(time - period) + 1)
        found: dict[str, list[Stamped]] = {STREAMS[port].topic: [] for port in self.ports}
        for topic, message in self._messages(starting_at=start, ending_at=now):
            if topic in found:
                found[topic].append(message)
        values = {}
        for port in self.ports:
            stream = STREAMS[port]
            messages = found[stream.topic]
            if not messages and stream in HELD:
                earlier = self._messages(topics=[stream.topic], ending_at=now, reverse=True)
                messages = [message for _, message in [next(earlier)]]
            values[port] = stream.decode(messages)
        return values
