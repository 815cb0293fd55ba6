"""Writes messages into a ROS 1 bag, a ROS 2 bag or an MCAP file."""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from crossmodal.systems.recordings.recording import RecordingError
from crossmodal.systems.recordings.ros_messages import made, ros2_types

KINDS = ("bag", "db3", "mcap")


class BagWriter:
    """A bag that is written message by message, to be used in a `with` statement.

    Args:
        path: Of a file for `bag`, of a folder for the two kinds of ROS 2; must not exist.
        kind: `bag` of ROS 1, `db3` or `mcap` of ROS 2.

    Raises:
        RecordingError: where it cannot be written, or there is no such kind.
    """

    def __init__(self, path: Path, kind: str) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        if kind not in KINDS:
            raise RecordingError(f"'{kind}' is no kind of bag; need {', '.join(KINDS)}")
        if path.exists():
            raise RecordingError(f"{path}: exists already; remove it, or name another")
        self._is_ros1 = kind == "bag"
        self._store = get_typestore(Stores.ROS1_NOETIC) if self._is_ros1 else ros2_types()
        if self._is_ros1:  # Which rosbags has of ROS 2 only.
            frames = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(frames, "tf2_msgs/msg/TFMessage"))
        self._connections: dict[str, Any] = {}
        self._writer: Any
        if self._is_ros1:
            self._writer = rosbag1.Writer(path)
            self._writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            self._writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.close()

    def write(self, topic: str, kind: str, fields: Mapping[str, Any], time: int) -> None:
        """Writes a message that was logged at `time` [ns]; fields that are not given are zero."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store
            )
        message = made(kind, fields, self._store)
        serialise = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic], time, serialise(message, kind))
