"""Poses over time in a recording: poses, transforms and points, odometry, and frames of TF."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.recordings.clock import StampClock
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import RecordingError, stamp_of

TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_WITH_POSE = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PointStamped",
    # Without a stamp they count from when they were logged.
    "geometry_msgs/msg/Pose",
    "geometry_msgs/msg/PoseWithCovariance",
    "geometry_msgs/msg/Transform",
    "geometry_msgs/msg/Point",
)
POSE_TYPES = (*_WITH_POSE, *TF)


def read_poses(path: Path, topic: str = "") -> tuple[Array, Array]:
    """Times (N,), [s], and poses of one topic, in order of time.

    Args:
        path: Of the recording.
        topic: Its name; of TF, which holds many frames, `TOPIC:CHILD`, the pose of the frame CHILD
            in its parent. May be empty where there is only one.

    Returns:
        Poses are (N, 7), x, y, z [m] and quaternions qx, qy, qz, qw, or positions (N, 3).

    Raises:
        RecordingError: where there are none, or several to choose from.
    """
    name, _, frame = topic.partition(":")
    with open_recording(path) as recording:
        topics = [facts.name for facts in recording.topics.values() if facts.type in POSE_TYPES]
        if not topics:
            raise RecordingError(
                f"{path}: has no poses; need a topic of {', '.join(POSE_TYPES[:-1])}"
            )
        if name and name not in topics:
            raise RecordingError(f"{path}: '{name}' is no topic of poses; has {', '.join(topics)}")
        read: dict[str, list[tuple[int, list[float]]]] = {}
        clocks: dict[str, StampClock] = {}
        for logged in recording.messages([name] if name else topics):
            is_tf = logged.type in TF
            for child, stamp, pose in _poses(logged.decode(), is_tf):
                key = f"{logged.topic}:{child}" if is_tf else logged.topic
                time = clocks.setdefault(key, StampClock()).time(stamp, logged.time)
                read.setdefault(key, []).append((time, pose))
    if frame:
        read = {key: rows for key, rows in read.items() if key == topic} or _refuse(path, read)
    # A frame that never moves is no tracker's; it counts only where nothing else is there.
    moving = {
        key: rows for key, rows in read.items() if any(pose != rows[0][1] for _, pose in rows)
    }
    chosen = moving if moving and not topic else read
    if len(chosen) != 1:
        _refuse(path, chosen)
    ((_, rows),) = chosen.items()
    times, index = np.unique([time for time, _ in rows], return_index=True)
    return 1e-9 * times, np.array([rows[k][1] for k in index], dtype=float)


def _refuse(path: Path, read: dict[str, Any]) -> Any:
    names = sorted(read)
    shown = ", ".join(names[:12]) + (" ..." if len(names) > 12 else "")
    if not names:
        raise RecordingError(f"{path}: holds no pose there")
    raise RecordingError(f"{path}: choose one of its poses by --topic: {shown}")


def _poses(message: Any, is_tf: bool) -> Iterator[tuple[str, int, list[float]]]:
    """Child frame, stamp [ns] and pose of each that a message holds."""
    for each in message.transforms if is_tf else [message]:
        yield str(getattr(each, "child_frame_id", "")).lstrip("/"), stamp_of(each), _pose(each)


def _pose(message: Any) -> list[float]:
    for name in ("transform", "pose", "pose", "point"):  # A pose with covariance is within another.
        message = getattr(message, name, message)
    if hasattr(message, "translation"):
        p, q = message.translation, message.rotation
    elif hasattr(message, "position"):
        p, q = message.position, message.orientation
    else:
        p, q = message, None
    return [p.x, p.y, p.z, *([] if q is None else [q.x, q.y, q.z, q.w])]
