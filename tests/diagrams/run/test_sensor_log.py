"""What is written into a sensor log is what is read from it."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from diagrams.run.sensor_log import STREAMS, SensorLog, SensorLogWriter
from diagrams.run.yaml_schema import ScenarioError
from systems.port_values import SampleWindow

PERIOD = 1 / 15
IMAGES = {
    "color_measured": ImageRgba8U,
    "depth_measured": ImageDepth32F,
    "robot_mask": ImageGrey8U,
}
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
        return image
    if port in WINDOWS:
        size, step = WINDOWS[port]
        first = int(np.floor(((tick - 1) * PERIOD + 1e-9) / step)) + 1
        times = np.arange(max(0, first), int((tick * PERIOD + 1e-9) / step) + 1) * step
        return SampleWindow(times=times, values=rng.normal(size=(len(times), size)))
    if port == "cheat_body_pose":
        return RigidTransform(RollPitchYaw(*rng.normal(size=3)), rng.normal(size=3))
    return rng.normal(size=1)


def assert_same(port: str, value: object, expected: object) -> None:
    if port in IMAGES:
        assert_array_equal(value.data, expected.data)
    elif port in WINDOWS:
        assert_allclose(value.times, expected.times, atol=1e-12)
        assert_array_equal(value.values, expected.values)
    elif port == "cheat_body_pose":
        assert_allclose(value.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-14)
    else:
        assert_array_equal(value, expected)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> SensorLog:
    path = tmp_path_factory.mktemp("log") / "sensors.mcap"
    writer = SensorLogWriter(path)
    for tick in range(4):
        for port, stream in STREAMS.items():
            if tick != 2 or port in WINDOWS:  # At the third tick only the windows have news.
                writer.write(stream, measured(port, tick), tick * PERIOD)
    writer.close()
    return SensorLog(path)


@pytest.mark.parametrize("tick", [3, 0, 1])
def test_every_port_is_read_as_it_was_written_in_any_order(log: SensorLog, tick: int) -> None:
    values = log.read(tick * PERIOD, PERIOD)
    assert set(values) == set(STREAMS)
    for port, value in values.items():
        assert_same(port, value, measured(port, tick))


def test_what_did_not_come_keeps_its_last_value(log: SensorLog) -> None:
    values = log.read(2 * PERIOD, PERIOD)
    for port, value in values.items():
        assert_same(port, value, measured(port, 2 if port in WINDOWS else 1))


def test_the_last_message_ends_the_log(log: SensorLog) -> None:
    assert_allclose(log.end, 3 * PERIOD, atol=1e-9)


def test_a_file_that_is_no_log_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "sensors.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ScenarioError, match=r"sensors\.mcap"):
        SensorLog(path)
    with pytest.raises(ScenarioError, match=r"cannot be read"):
        SensorLog(tmp_path / "absent.mcap")


def test_a_log_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    writer = SensorLogWriter(tmp_path / "sensors.mcap")
    writer.write(STREAMS["interaction_active"], [1.0], 0.0)
    assert not (tmp_path / "sensors.mcap").exists()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["sensors.mcap"]
