"""What is written into a sensor log is what is read from it."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.diagrams.crossmodal.episode_parts import TOPICS
from crossmodal.diagrams.run.calibration import Calibration, CameraCalibration
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorLogWriter,
    SensorRecorder,
    Stream,
    make_streams,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import SampleWindow, StampedImage

PERIOD = 1 / 15
IMAGES = {
    "color_measured": ImageRgba8U,
    "depth_measured": ImageDepth32F,
    "robot_mask": ImageGrey8U,
}
STAMPED = ("color_measured", "depth_measured")
WINDOWS = {
    "joint_state_window": (14, 0.005),
    "wrench_window": (6, 0.01),
    "pressure_window": (4, 0.01),
}


def measured(port: str, tick: int) -> object:
    """A value of a port at a tick, different at each."""
    rng = np.random.default_rng((tick, len(port)))
    if port in IMAGES:
        image = IMAGES[port](8, 6)
        image.mutable_data[:] = rng.uniform(0, 200, image.mutable_data.shape)
        # Taken a while before it was logged.
        return StampedImage(time=tick * PERIOD - 0.01, image=image) if port in STAMPED else image
    if port in WINDOWS:
        size, step = WINDOWS[port]
        first = int(np.floor(((tick - 1) * PERIOD + 1e-9) / step)) + 1
        times = np.arange(max(0, first), int((tick * PERIOD + 1e-9) / step) + 1) * step
        return SampleWindow(times=times, values=rng.normal(size=(len(times), size)))
    if port == "cheat_body_pose":
        return RigidTransform(RollPitchYaw(*rng.normal(size=3)), rng.normal(size=3))
    if port == "task_status":
        return TaskStatus(phase=f"phase {tick}")
    return rng.normal(size=1)


PORTS = (*IMAGES, *WINDOWS, "interaction_active", "cheat_configuration", "cheat_body_pose",
         "task_status")  # fmt: skip


def streams() -> list[Stream]:
    return make_streams({port: measured(port, 0) for port in PORTS}, TOPICS)


def assert_same(port: str, value: object, expected: object) -> None:
    if port in STAMPED:
        assert_allclose(value.time, expected.time, atol=1e-9)
        assert_array_equal(value.image.data, expected.image.data)
    elif port in IMAGES:
        assert_array_equal(value.data, expected.data)
    elif port in WINDOWS:
        assert_allclose(value.times, expected.times, atol=1e-12)
        assert_array_equal(value.values, expected.values)
    elif port == "cheat_body_pose":
        assert_allclose(value.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-14)
    elif port == "task_status":
        assert value == expected
    else:
        assert_array_equal(value, expected)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> SensorLog:
    path = tmp_path_factory.mktemp("log") / "sensors.mcap"
    writer = SensorLogWriter(path)
    for tick in range(4):
        for stream in streams():
            if tick != 2 or stream.port in WINDOWS:  # At the third tick only windows have news.
                writer.write(stream, measured(stream.port, tick), tick * PERIOD)
    writer.close()
    return SensorLog(path, streams())


@pytest.mark.parametrize("tick", [3, 0, 1])
def test_every_port_is_read_as_it_was_written_in_any_order(log: SensorLog, tick: int) -> None:
    values = log.read(tick * PERIOD, PERIOD)
    assert set(values) == set(PORTS)
    for port, value in values.items():
        assert_same(port, value, measured(port, tick))


@pytest.mark.parametrize("before", [1, 0, 3])
def test_what_did_not_come_keeps_its_last_value(log: SensorLog, before: int) -> None:
    """Also after another instant was read than the last one."""
    log.read(before * PERIOD, PERIOD)
    values = log.read(2 * PERIOD, PERIOD)
    for port, value in values.items():
        assert_same(port, value, measured(port, 2 if port in WINDOWS else 1))


class Status(LeafSystem):
    """Gives one status as long as it lasts."""

    def __init__(self, period: float) -> None:
        super().__init__()
        self._statuses = [TaskStatus(phase=name) for name in ("look", "touch")]
        self.DeclareAbstractOutputPort(
            "task_status",
            lambda: AbstractValue.Make(TaskStatus()),
            lambda context, output: output.set_value(
                self._statuses[int(context.get_time() / period + 1e-6) // 3]
            ),
        )


def test_a_value_that_lasts_is_written_once(tmp_path: Path) -> None:
    path, builder = tmp_path / "sensors.mcap", DiagramBuilder()
    (stream,) = make_streams({"task_status": TaskStatus()}, {})
    recorder = builder.AddSystem(SensorRecorder(path, [stream], PERIOD))
    builder.Connect(builder.AddSystem(Status(PERIOD)).get_output_port(), recorder.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(5 * PERIOD + 1e-3)
    recorder.log.close()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 2
    read = SensorLog(path, [stream])
    phases = [read.read(tick * PERIOD, PERIOD)["task_status"].phase for tick in range(6)]
    assert phases == ["look"] * 3 + ["touch"] * 3


def placed(tick: int) -> StampedImage:
    """An image of a camera that moves."""
    X_WC = se3.exp(np.array([0.1, 0.2, -0.3, 0.4, 0.5, tick]))
    covariance = np.diag(np.arange(1.0, 7.0)) * (tick + 1.0)
    image = ImageDepth32F(2, 2, float(tick + 1))
    return StampedImage(time=tick * PERIOD, image=image, X_WC=X_WC, covariance=covariance)


def calibration_of(base_frame: str) -> Calibration:
    camera = CameraCalibration(
        intrinsics=Intrinsics(
            width=2, height=2, focal_x=2.0, focal_y=2.0, center_x=0.5, center_y=0.5
        ),
        base_frame=base_frame,
        X_PC=RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0]),
        pose_covariance=np.diag(np.linspace(0.1, 0.6, 6)),
    )
    return Calibration(cameras={"camera": camera})


def recorded(path: Path, recorder: Calibration | None) -> set[str]:
    """Writes four images as with the cameras of the recorder; returns the topics of the file."""
    (stream,) = make_streams({"depth_measured": placed(0)}, TOPICS, recorder)
    writer = SensorLogWriter(path)
    for tick in range(4):
        writer.write(stream, placed(tick), tick * PERIOD)
    writer.close()
    return {topic for topic, _ in stream.parts}


def test_a_recording_says_where_a_camera_was_that_moves(tmp_path: Path) -> None:
    moving = calibration_of("arm::tool_plate")
    path = tmp_path / "sensors.mcap"
    topic = TOPICS["depth_measured"].name
    assert recorded(path, moving) == {topic, f"{topic}/pose"}
    log = SensorLog(path, make_streams({"depth_measured": placed(0)}, TOPICS, moving))
    for tick in (3, 1):
        image = log.read(tick * PERIOD, PERIOD)["depth_measured"]
        assert_allclose(image.X_WC, placed(tick).X_WC, atol=1e-14)
        assert_allclose(image.covariance, placed(tick).covariance, atol=1e-12)
    late = log.read(9 * PERIOD, PERIOD)["depth_measured"]  # Nothing new has come.
    assert_allclose(late.X_WC, placed(3).X_WC, atol=1e-14)


def test_a_fixed_camera_is_where_the_calibration_of_the_replay_says(tmp_path: Path) -> None:
    fixed = calibration_of("world")
    path = tmp_path / "sensors.mcap"
    assert recorded(path, fixed) == {TOPICS["depth_measured"].name}
    log = SensorLog(path, make_streams({"depth_measured": placed(0)}, TOPICS, fixed))
    image = log.read(PERIOD, PERIOD)["depth_measured"]
    assert_array_equal(image.X_WC, fixed.camera.X_PC.GetAsMatrix4())
    assert_array_equal(image.covariance, fixed.camera.pose_covariance)


def test_a_recording_without_poses_leaves_open_where_a_moving_camera_was(tmp_path: Path) -> None:
    path = tmp_path / "sensors.mcap"
    recorded(path, None)
    moving = calibration_of("arm::tool_plate")
    log = SensorLog(path, make_streams({"depth_measured": placed(0)}, TOPICS, moving))
    image = log.read(PERIOD, PERIOD)["depth_measured"]
    assert np.isnan(image.X_WC).all()
    assert_array_equal(image.image.data, placed(1).image.data)


def test_the_last_message_ends_the_log(log: SensorLog) -> None:
    assert_allclose(log.end, 3 * PERIOD, atol=1e-9)


def test_a_window_without_messages_is_empty(log: SensorLog) -> None:
    window = log.read(9 * PERIOD, PERIOD)["joint_state_window"]
    assert window.values.shape == (0, 14)


def test_streams_that_a_file_does_not_hold_are_left_out(log: SensorLog, tmp_path: Path) -> None:
    known = make_streams({"cheat_joint": TaskStatus(), "pressure_window": np.zeros(1)}, TOPICS)
    path = tmp_path / "sensors.mcap"
    writer = SensorLogWriter(path)
    writer.write(known[1], np.ones(1), 0.0)
    writer.close()
    assert [stream.port for stream in SensorLog(path, known).streams] == ["pressure_window"]


def test_a_stream_that_begins_late_is_named(tmp_path: Path) -> None:
    known = make_streams({"early": np.zeros(1), "late": np.zeros(1)}, {})
    writer = SensorLogWriter(tmp_path / "sensors.mcap")
    writer.write(known[0], np.ones(1), 0.0)
    for stream in known:
        writer.write(stream, np.ones(1), 0.5)
    writer.close()
    log = SensorLog(tmp_path / "sensors.mcap", known)
    with pytest.raises(ScenarioError, match=r"the stream 'late' begins only after 0\.25 s"):
        log.read(0.25, 0.25)
    assert set(log.read(0.5, 0.25)) == {"early", "late"}


def test_a_port_without_a_topic_of_its_own_has_one_with_its_name() -> None:
    topics = {stream.port: stream.topic for stream in streams()}
    assert topics["task_status"] == "/task_status"
    assert topics["joint_state_window"] == "/joint_states"


def test_a_file_that_is_no_log_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "sensors.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ScenarioError, match=r"sensors\.mcap"):
        SensorLog(path, streams())
    with pytest.raises(ScenarioError, match=r"cannot be read"):
        SensorLog(tmp_path / "absent.mcap", streams())


def test_a_log_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    writer = SensorLogWriter(tmp_path / "sensors.mcap")
    (stream,) = make_streams({"interaction_active": np.zeros(1)}, TOPICS)
    writer.write(stream, [1.0], 0.0)
    assert not (tmp_path / "sensors.mcap").exists()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["sensors.mcap"]
