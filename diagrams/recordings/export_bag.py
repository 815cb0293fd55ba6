"""A run's recorded sensor streams as a bag that other programs of ROS read."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE
from crossmodal.diagrams.run.replay import check_recorded
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.camera_info import CAMERA_INFO, camera_info
from crossmodal.systems.recordings.recording import RecordingError
from crossmodal.systems.recordings.ros_messages import header

_INFO_INTERVAL = 1_000_000_000  # Of the camera info's messages, [ns].


def export_bag(run: Path, path: Path, kind: str) -> Path:
    """Writes all streams of a run with `sensors.mcap`, and the info of its cameras.

    Args:
        run: Its folder.
        path: Of the bag: a file of ROS 1, a folder of ROS 2; must not exist.
        kind: `bag` of ROS 1, `db3` or `mcap` of ROS 2.

    Raises:
        ScenarioError: where there is no recording, or the bag cannot be written.
    """
    application, scenario = load_scenario(str(check_recorded(run)))
    calibration = application.make_calibration(scenario)
    infos = {}
    for port, topic in application.topics(scenario).items():
        camera = calibration.camera_of(port) if port.endswith("color_measured") else None
        if camera is not None:
            infos[topic.name] = (
                f"{topic.name.rpartition('/')[0]}/camera_info",
                camera_info(camera.intrinsics),
            )
    last: dict[str, int] = {}
    try:
        with BagWriter(path, kind) as writer:
            for name, message_type, message, time in _messages(run / SENSORS_FILE):
                if name in infos and time >= last.get(name, -_INFO_INTERVAL) + _INFO_INTERVAL:
                    beside, info = infos[name]
                    writer.write(beside, CAMERA_INFO, info | {"header": header(time)}, time)
                    last[name] = time
                writer.write(name, message_type, _fields(message), time)
    except (RecordingError, OSError) as error:
        raise ScenarioError(f"{path}: cannot be written: {one_line(error)}") from None
    return path


def _messages(path: Path) -> Iterator[tuple[str, str, Any, int]]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for found in reader.iter_decoded_messages():
            kind = "" if found.schema is None else found.schema.name
            yield found.channel.topic, kind, found.decoded_message, found.message.log_time


def _fields(message: Any) -> dict[str, Any]:
    """The fields of a decoded message, with those of the messages in it."""
    return {name: _plain(getattr(message, name)) for name in message.__slots__}


def _plain(value: Any) -> Any:
    if hasattr(value, "__slots__") and not isinstance(value, bytes | str | np.ndarray | memoryview):
        return _fields(value)
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return bytes(value) if isinstance(value, memoryview) else value
