"""A recording that is not as it was written is refused, never read as something else."""

import os
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.sensors import ImageRgba8U

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.recordings.survey import survey
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.recorded_scenario import check_unchanged, is_replaceable
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorLogWriter,
    Stream,
    make_streams,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.recordings.recording import RecordingError

TICKS = 6


def window(size: int = 2, times: tuple[float, ...] = (0.0,)) -> SampleWindow:
    return SampleWindow(times=np.array(times), values=np.ones((len(times), size)))


def streams(image: tuple[int, int] = (8, 6), size: int = 2) -> list[Stream]:
    models = {"camera": ImageRgba8U(*image), "joints": window(size), "force": np.zeros(size)}
    return make_streams(models, {})


def write(path: Path, scenario: str = "name: a\n") -> Path:
    """A small recording, in several chunks' worth of random pixels."""
    rng = np.random.default_rng(0)
    writer = SensorLogWriter(path, scenario)
    for tick in range(TICKS):
        image = ImageRgba8U(8, 6)
        image.mutable_data[:] = rng.integers(0, 255, image.mutable_data.shape)
        values = [image, window(times=(float(tick),)), rng.normal(size=2)]
        for stream, value in zip(streams(), values, strict=True):
            writer.write(stream, value, float(tick))
    writer.close(float(TICKS - 1))
    return path


def content(path: Path) -> list[object]:
    """All that is read from a recording."""
    log = SensorLog(path, streams())
    found: list[object] = [log.scenario, log.end]
    for tick in range(TICKS):
        values = log.read(float(tick), 1.0)
        samples = values["joints"]
        found += [values["camera"].data.tolist(), samples.times.tolist(), samples.values.tolist()]
        found.append(list(values["force"]))
    return found


def test_a_wrong_bit_anywhere_is_never_read_as_another(tmp_path: Path) -> None:
    """Neither by a replay nor as what `crossmodal inspect` reads."""
    whole = write(tmp_path / "whole.mcap").read_bytes()
    damaged = tmp_path / "damaged.mcap"
    rng = np.random.default_rng(1)
    for bit in rng.integers(8 * len(whole), size=100):
        wrong = bytearray(whole)
        wrong[bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(wrong)
        with pytest.raises(ScenarioError, match=r"damaged\.mcap: (is damaged|cannot be read): ."):
            content(damaged)
        with pytest.raises(RecordingError, match=r"^.{,300}$"):
            survey(damaged)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_recording_that_is_cut_off_is_refused(tmp_path: Path, share: float) -> None:
    path = write(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ScenarioError, match=r"a\.mcap: cannot be read"):
        SensorLog(path, streams())


def test_a_recording_knows_what_it_is_of_and_how_long_it_took(tmp_path: Path) -> None:
    log = SensorLog(write(tmp_path / "a.mcap", "seed: 3\n"), streams())
    assert (log.scenario, log.end) == ("seed: 3\n", 5.0)


@pytest.mark.parametrize("duration", [1e9, np.nan, np.inf, -1.0])
def test_an_end_that_cannot_be_is_refused(duration: float, tmp_path: Path) -> None:
    writer = SensorLogWriter(tmp_path / "a.mcap")
    writer.write(streams()[2], np.zeros(2), 1.0)
    writer.close(duration)
    with pytest.raises(ScenarioError, match=r"it says that it ends at .*last message is of 1 s"):
        SensorLog(tmp_path / "a.mcap", streams())


@pytest.mark.parametrize("scenario", ["[", "- a", "text", "a: " + "{b: " * 3000, "a: 1\na: 2"])
def test_a_recording_of_no_scenario_is_refused(scenario: str) -> None:
    with pytest.raises(ScenarioError, match="the recording's scenario"):
        check_unchanged(APPLICATION, load_scenario("drawer")[1], scenario, "mine.yaml")


def test_what_only_another_version_says_is_no_difference_in_a_list_either() -> None:
    scenario = load_scenario("drawer-lights-off")[1]
    recorded = contents(APPLICATION, scenario)
    older = "".join(line for line in recorded.splitlines(True) if "remaining" not in line)
    assert older != recorded
    check_unchanged(APPLICATION, scenario, older, "mine.yaml")
    start = f"start: {scenario.disturbances.lights_off[0].start}"
    assert start in older
    with pytest.raises(ScenarioError, match=r"disturbances\.lights_off\[0\]\.start = .*recorded"):
        check_unchanged(APPLICATION, scenario, older.replace(start, "start: 99.0"), "mine.yaml")
    assert is_replaceable(APPLICATION, "disturbances.faults[0].start")
    assert not is_replaceable(APPLICATION, "disturbances.faulty")


def test_nobody_waits_at_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(ScenarioError, match=r"a\.mcap: cannot be read: it is no file"):
        SensorLog(tmp_path / "a.mcap", streams())


def test_values_that_are_no_numbers_are_handed_on(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = SensorLogWriter(path)
    nothing = SampleWindow(times=np.zeros(1), values=np.full((1, 2), np.nan))
    (_, joints, force) = streams()
    writer.write(joints, nothing, 0.0)
    writer.write(force, np.array([np.nan, 1.0]), 0.0)
    writer.close()
    values = SensorLog(path, [joints, force]).read(0.0, 1.0)
    assert np.all(np.isnan(values["joints"].values))
    assert np.isnan(values["force"][0])


@pytest.mark.parametrize(
    ("read_as", "message"),
    [
        ({"image": (4, 3)}, "images of 8 x 6 pixels, but 4 x 3 as the scenario's camera has them"),
        ({"size": 3}, "samples of 2 numbers, but 3 is expected"),
    ],
)
def test_values_of_another_size_are_refused_with_their_stream(
    tmp_path: Path, read_as: dict, message: str
) -> None:
    log = SensorLog(write(tmp_path / "a.mcap"), streams(**read_as))
    with pytest.raises(ScenarioError, match=rf"a\.mcap: '/\w+' at 0\.00 s: {message}"):
        log.read(0.0, 1.0)


def test_a_stream_of_another_type_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with pytest.raises(ScenarioError, match="'/camera' holds sensor_msgs/msg/Image, but std_msgs"):
        SensorLog(path, make_streams({"camera": np.zeros(3)}, {}))


def test_a_stream_without_messages_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    log = SensorLogWriter(path)
    _, joints, force = streams()
    log.write(force, np.ones(2), 0.0)
    empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
    log.write(joints, empty, 0.0)
    log.close()
    assert [stream.port for stream in SensorLog(path, [joints, force]).streams] == ["force"]


def test_a_full_disk_ends_the_recording_and_not_the_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = SensorLogWriter(tmp_path / "a.mcap")
    _, joints, _ = streams()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(log._file, "write", full)
    for tick in range(3):
        log.write(joints, window(), float(tick))
    log.close(2.0)
    assert log.failure == f"{tmp_path}/a.mcap: cannot be written: No space left on device"
    assert list(tmp_path.iterdir()) == []
