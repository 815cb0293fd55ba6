"""Messages of ROS as the tests need them, and bags of them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.open_recording import open_recording

START = 1_700_000_000_000_000_000  # [ns]
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
Row = tuple[str, str, dict[str, Any], int]  # Topic, type, fields and log time [ns].


def header(time: int, frame: str = "") -> dict[str, Any]:
    seconds, rest = divmod(time, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def image(data: np.ndarray, encoding: str, time: int = START, **fields: Any) -> dict[str, Any]:
    step = data.strides[0]
    made = {"header": header(time), "height": data.shape[0], "width": data.shape[1]}
    return made | {"encoding": encoding, "step": step, "data": data.tobytes()} | fields


def pose(p: Iterable[float], q: Iterable[float] = (0.0, 0.0, 0.0, 1.0)) -> dict[str, Any]:
    return {
        "position": dict(zip("xyz", map(float, p), strict=True)),
        "orientation": dict(zip("xyzw", map(float, q), strict=True)),
    }


def transform(p: Iterable[float], q: Iterable[float]) -> dict[str, Any]:
    made = pose(p, q)
    return {"translation": made["position"], "rotation": made["orientation"]}


def read_all(path: Path) -> None:
    """Opens a recording and decodes each of its messages."""
    with open_recording(path) as recording:
        for logged in recording.messages(recording.topics):
            logged.decode()


def write_bag(path: Path, kind: str, rows: Iterable[Row]) -> Path:
    with BagWriter(path, kind) as writer:
        for topic, message_type, fields, time in rows:
            writer.write(topic, message_type, fields, time)
    return path
