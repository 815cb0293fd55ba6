"""A run's recorded sensor streams as a bag that other programs of ROS read."""

from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE
from crossmodal.diagrams.run.replay import check_recorded
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.camera_info import CAMERA_INFO, camera_info
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import RecordingError
from crossmodal.systems.recordings.ros_messages import header

_INFO_INTERVAL = 1_000_000_000  # Of the camera info's messages, [ns].


def export_bag(run: Path, path: Path, kind: str) -> Path:
    """Writes all streams of a run with `sensors.mcap`, and the info of its cameras.

    Args:
        run: Its folder.
        path: Of the bag: a file of ROS 1, a folder of ROS 2; a file there is replaced.
        kind: `bag` of ROS 1, `db3` or `mcap` of ROS 2.

    Raises:
        ScenarioError: where there is no recording, it is damaged, or the bag cannot be written.
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
    due: dict[str, int] = {}  # When a camera's info is written again, [ns].
    try:
        with open_recording(run / SENSORS_FILE) as recording:
            path.parent.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(dir=path.parent, prefix=f".{path.name}-") as folder:
                partial = Path(folder, path.name)
                with BagWriter(partial, kind) as writer:
                    for logged in recording.messages(list(recording.topics)):
                        name, time = logged.topic, logged.time
                        if name in infos and time >= due.get(name, 0):
                            beside, info = infos[name]
                            writer.write(beside, CAMERA_INFO, info | {"header": header(time)}, time)
                            due[name] = time + _INFO_INTERVAL
                        writer.write(name, logged.type, asdict(logged.decode()), time)
                path.unlink(missing_ok=True)
                partial.rename(path)
    except RecordingError as error:
        raise ScenarioError(str(error)) from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be written: {one_line(error)}") from None
    return path
