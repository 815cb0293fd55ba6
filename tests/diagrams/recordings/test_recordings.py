"""Foreign recordings: what is said of them, how their streams are read, and what is refused."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal
from ros_messages import IMAGE, INFO, START, Row, header, image, transform, write_bag
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.recordings.calibration_file import RecordedRobot, read_calibration
from crossmodal.diagrams.recordings.port_sources import Rectifier, WindowSource
from crossmodal.diagrams.recordings.recording_log import RecordingLog
from crossmodal.diagrams.recordings.replay_recording import prepare
from crossmodal.diagrams.recordings.report import described, drafts
from crossmodal.diagrams.recordings.sample_rows import JointRows, PressureRows
from crossmodal.diagrams.recordings.survey import JOINTS, WRENCH, survey
from crossmodal.diagrams.recordings.topic_map import (
    TopicMap,
    likely_topic_map,
    read_topic_map,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, load_typed
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.recordings.camera_info import CameraFacts
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import RecordingError

WIDTH, HEIGHT = 32, 24
MS = 1_000_000
COLOR, DEPTH, INFOS = "/camera/rgb/image_raw", "/camera/depth_registered/image", "/camera/rgb/info"
FACTS = {
    "width": WIDTH,
    "height": HEIGHT,
    "distortion_model": "plumb_bob",
    "d": [0.1, 0.0, 0.0, 0.0, 0.0],
}
FACTS |= {"k": [30.0, 0.0, 15.5, 0.0, 30.0, 11.5, 0.0, 0.0, 1.0]}
BGR = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
MILLIMETRES = np.full((HEIGHT, WIDTH), 800, dtype=np.uint16)


def camera(count: int = 30, *, period: int = 33 * MS, start: int = START) -> list[Row]:
    rows: list[Row] = []
    for k in range(count):
        time = start + k * period
        rows.append((COLOR, IMAGE, image(BGR, "bgr8", time), time + 20 * MS))
        rows.append((DEPTH, IMAGE, image(MILLIMETRES, "16UC1", time + MS), time + 25 * MS))
        rows.append((INFOS, INFO, FACTS | {"header": header(time)}, time + 20 * MS))
    return rows


def arm(count: int = 60) -> list[Row]:
    rows: list[Row] = []
    for k in range(count):
        time = START + k * 10 * MS
        q = [0.01 * k] * 7
        names = [f"wam_{j}" for j in range(1, 8)]
        rows.append(
            ("/joint_states", JOINTS, {"header": header(time), "name": names, "position": q}, time)
        )
        wrench = {"force": {"x": 1.0, "y": 2.0, "z": 3.0}, "torque": {"x": 4.0, "y": 5.0, "z": 6.0}}
        rows.append(("/ft", WRENCH, {"header": header(time), "wrench": wrench}, time))
    return rows


def bag(path: Path, rows: list[Row]) -> Path:
    return write_bag(path / "x.bag", "bag", sorted(rows, key=lambda row: row[3]))


def test_a_camera_alone_is_surveyed_and_its_drafts_can_be_read(tmp_path: Path) -> None:
    found = survey(bag(tmp_path, camera()[:-15] + camera(60)[-6:]))
    said = "\n".join(described(found))
    assert f"vision: {COLOR} with {DEPTH}" in said
    assert "proprioception" not in said
    assert "32 x 24 bgr8" in said
    assert "gaps: " in said
    assert f"crossmodal replay {found.path} --robot wam" in said
    for name, text in drafts(found).items():
        (tmp_path / name).write_text(text)
    chosen = read_topic_map(tmp_path / "topics.yaml", found)
    assert (chosen.color, chosen.depth, chosen.camera_info) == (COLOR, DEPTH, INFOS)
    facts = read_calibration(tmp_path / "calibration.yaml").camera.facts()
    assert facts is not None
    assert facts.intrinsics.vector().tolist() == [30.0, 30.0, 15.5, 11.5]
    assert facts.distortion.tolist() == [0.1, 0.0, 0.0, 0.0, 0.0]


def test_frames_of_tf_that_come_in_bunches_have_a_rate_and_no_gaps(tmp_path: Path) -> None:
    rows = []
    for k in range(40):
        time = START + (k // 4) * 100 * MS + (k % 4) * 1000
        frame = {"header": header(time, "map"), "child_frame_id": f"part_{k % 4}"}
        frame["transform"] = transform([0.01 * k, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        rows.append(("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [frame]}, time))
    (found,) = survey(bag(tmp_path, rows)).topics.values()
    assert 40 < found.rate < 45
    assert found.gaps == []
    assert found.holds() == "part_0, part_1, part_2, part_3"


def test_a_pose_alone_has_a_command_but_no_drafts(tmp_path: Path) -> None:
    pose_at = [({"x": 0.1 * k, "y": 0.0, "z": 0.0}, START + k * 100 * MS) for k in range(5)]
    rows = [("/lid", "geometry_msgs/msg/Point", point, time) for point, time in pose_at]
    path = str(bag(tmp_path, rows))
    output = CliRunner().invoke(app, ["inspect", path]).output
    assert "1 topic, 0.4 s" in output
    assert f"crossmodal joints {path} --topic /lid" in output
    assert "Draft" not in output


def test_the_command_says_it_and_writes_the_drafts_once(tmp_path: Path) -> None:
    path = str(bag(tmp_path, camera(3)))
    runner = CliRunner()
    assert "Draft of topics.yaml" in runner.invoke(app, ["inspect", path]).output
    options = ["inspect", path, "--drafts", str(tmp_path)]
    assert runner.invoke(app, options).exit_code == 0
    again = runner.invoke(app, options)
    assert again.exit_code == 2
    assert again.stderr.endswith("exists already; replace it with --force\n")
    assert runner.invoke(app, [*options, "--force"]).exit_code == 0


def read(path: Path, topic: str, ticks: int = 4) -> list[Any]:
    """The windows of a topic's wrenches at some ticks of 0.1 s."""
    found = survey(path)
    source = WindowSource(
        [topic], lambda topic, time, message: np.array([message.wrench.force.x]), 1
    )
    log = RecordingLog(found, {"port": source}, [], START, START + 1000 * MS)
    return [log.read(0.1 * k, 0.1)["port"] for k in range(ticks)]


def forces(stamps: list[int], logged: list[int]) -> list[Row]:
    return [
        ("/ft", WRENCH, {"header": header(s), "wrench": {"force": {"x": float(k)}}}, t)
        for k, (s, t) in enumerate(zip(stamps, logged, strict=True))
    ]


STEADY = [START + 50 * MS * k for k in range(7)]


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        (STEADY, [[0], [1, 2], [3, 4], [5, 6]]),
        ([*STEADY[:2], STEADY[3], STEADY[2], *STEADY[4:]], [[0], [1, 3], [2, 4], [5, 6]]),
        ([*STEADY[:3], *(stamp - START for stamp in STEADY[3:])], [[0], [1, 2], [3, 4], [5, 6]]),
        ([0] * 7, [[0], [1, 2], [3, 4], [5, 6]]),
    ],
    ids=["steady", "out of order", "a clock that is set", "no stamps"],
)
def test_samples_come_at_the_tick_at_which_they_were_measured(
    stamps: list[int], expected: list[list[int]], tmp_path: Path
) -> None:
    windows = read(bag(tmp_path, forces(stamps, STEADY)), "/ft")
    assert [window.values[:, 0].astype(int).tolist() for window in windows] == expected
    for window in windows:
        assert (np.diff(window.times) > 0.0).all()


def test_a_log_whose_times_stand_still_is_read_by_its_stamps(tmp_path: Path) -> None:
    windows = read(bag(tmp_path, forces(STEADY, [START] * 7)), "/ft")
    assert [len(window.times) for window in windows] == [1, 2, 2, 2]


def test_joints_are_ordered_by_name_and_rates_follow_from_positions(tmp_path: Path) -> None:
    names = [f"j{k}" for k in range(3)]
    rows = JointRows("/joints", names, 3)

    class Message:
        name, position, velocity = ["j2", "j0", "j1", "x"], [2.0, 0.0, 1.0, 9.0], []

    assert rows("/joints", 0, Message) is None
    Message.position = [2.5, 0.5, 1.5, 9.0]
    found = rows("/joints", 500 * MS, Message)
    assert_allclose(found, [0.5, 1.5, 2.5, 1.0, 1.0, 1.0])
    Message.name = ["j2", "x", "y", "z"]
    with pytest.raises(RecordingError, match="has no joint 'j0'"):
        rows("/joints", 600 * MS, Message)
    with pytest.raises(RecordingError, match="names 2 joints; the arm has 3"):
        JointRows("/joints", names[:2], 3)


def test_four_topics_of_pressure_are_one_sample() -> None:
    topics = ["/a", "/b", "/c", "/d"]
    rows = PressureRows(topics)

    class Message:
        fluid_pressure = 1.0

    assert [rows(topic, 0, Message) is None for topic in topics] == [True, True, True, False]


def test_depth_of_another_size_is_brought_to_that_of_the_colour_image() -> None:
    inner = Intrinsics(width=4, height=2, focal_x=3.0, focal_y=3.0, center_x=1.5, center_y=0.5)
    rectifier = Rectifier(CameraFacts(intrinsics=inner))

    class Message:
        encoding, is_bigendian, width, height, step = "16UC1", 0, 2, 1, 4
        data = np.array([1000, 2000], dtype="<u2").view(np.uint8)

    assert_array_equal(rectifier.depth(Message), [[1.0, 1.0, 2.0, 2.0]] * 2)
    Message.width = Message.step = 1
    Message.encoding = "mono8"
    with pytest.raises(RecordingError, match="registered to the colour image"):
        rectifier.color(Message)


@pytest.mark.parametrize(
    ("rows", "topics", "calibration", "said"),
    [
        (camera(), "color: /none", "", "color = '/none': .*allowed: "),
        (camera(), f"color: {INFOS}", "", "holds sensor_msgs/msg/CameraInfo; need sensor_msgs"),
        (camera(), "colour: /x", "", "unknown key 'colour'; did you mean 'color'"),
        (camera(), f"color: {COLOR}", "", "needs topics of color and depth, or of joint_states"),
        (arm(), "", "", "needs topics of color and depth"),
        (camera(), f"pressures: [{COLOR}]", "", "holds sensor_msgs/msg/Image; need std_msgs"),
        (camera(), f"{{color: {COLOR}, depth: {DEPTH}}}", "", "has no camera info; write camera"),
        (camera() + arm(), "truth: {topic: /ft}", "", "/ft' holds geometry_msgs/msg/Wrench.*need"),
        (camera() + arm(), "truth: {topic: /joint_states}", "", "truth.joint = ''.*wam_1"),
        (
            camera() + arm(),
            "truth: {topic: /joint_states, joint: wam_1}",
            "",
            "truth.type = ''.*prismatic",
        ),
        (camera(), "truth: {type: prismatic}", "", "truth needs a topic"),
        (camera(), "", "camera: {focal_x: 30}", "focal_x needs width and height"),
        (camera(), "", "camera: {quaternion: [0, 0, 0, 0]}", "quaternion: need x, y, z, w"),
        (camera(), "", "camera: {position: [0, 0]}", "camera.position = .* need 3 numbers"),
        (camera(), "", "camera: {wide: 3}", "unknown key 'camera.wide'"),
        (camera(), "", "camera: {depth_scale: 0}", "depth_scale"),
        (camera(), "", "errors: {camera_rotation: -1}", "camera_rotation"),
        (
            [row for row in camera() if row[0] == COLOR]
            + [row for row in camera(start=START + 60_000 * MS) if row[0] != COLOR],
            "",
            "",
            "were not recorded at the same time",
        ),
        (camera()[:2], "", "camera: {width: 32, height: 24, focal_x: 30}", "the same time"),
        (camera(), "", "camera: {width: 32, height: 32, focal_x: 30}", "images of 32 x 24 pixels"),
    ],
)
def test_maps_and_calibrations_that_do_not_fit_are_refused_in_one_line(
    rows: list[Row], topics: str, calibration: str, said: str, tmp_path: Path
) -> None:
    path, my, chosen = bag(tmp_path, rows), tmp_path / "my.yaml", tmp_path / "map.yaml"
    my.write_text(calibration or "{}")
    chosen.write_text(topics or "{}")
    options = [
        "--robot",
        "wam",
        "--calibration",
        str(my),
        *(["--topics", str(chosen)] * bool(topics)),
    ]
    result = CliRunner().invoke(app, ["replay", str(path), *options])
    assert result.exit_code == 2, result.output
    assert result.stderr.count("\n") == 1
    assert re.search(said, result.stderr), result.stderr


def test_other_robots_and_settings_of_what_was_measured_are_refused(tmp_path: Path) -> None:
    found = survey(bag(tmp_path, camera(3)))
    chosen = likely_topic_map(found)
    with pytest.raises(ScenarioError, match="--robot 'ur5'"):
        prepare(found, chosen, RecordedRobot(), "ur5")
    with pytest.raises(ScenarioError, match="keeps what was measured"):
        prepare(found, chosen, RecordedRobot(), overrides=["task.opening=1"])
    with pytest.raises(ScenarioError, match="has no streams for crossmodal"):
        prepare(found, chosen, RecordedRobot(), overrides=["modalities=[crossmodal]"])


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, and its replay by two estimators, one of them a variant."""
    folder = tmp_path_factory.mktemp("replayed")
    rows = camera(6)
    for row in rows:
        row[2]["header"]["frame_id"] = "optical"
    path = bag(folder, rows)
    (folder / "my.yaml").write_text("{world: base_link, errors: {camera_rotation: 0.5 deg}}")
    (folder / "mine.py").write_text(
        "from crossmodal.systems.vision.camera.camera_motion import CameraMotion as Camera\n"
    )
    options = ["--robot", "wam", "--calibration", str(folder / "my.yaml")]
    options += ["--out", str(folder / "out"), "--stream", str(folder / "stream.mcap")]
    for assignment in (
        "modalities=[vision, mine]",
        "variants.mine.of=vision",
        "variants.mine.replacements.camera_motion=mine.py:Camera",
    ):
        options += ["--set", assignment]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        result = CliRunner().invoke(app, ["replay", str(path), *options])
    assert result.exit_code == 0, result.output
    return folder


def test_a_filter_of_ones_own_perceives_a_recording_beside_ours(replayed: Path) -> None:
    summary = json.loads((replayed / "out/summary.json").read_text())
    assert set(summary["modalities"]) == {"vision", "mine"}
    assert "mine" in (replayed / "out/scenario.yaml").read_text()
    found = survey(replayed / "x.bag")
    with pytest.raises(ScenarioError, match=r"variants.mine.of: .*no streams for crossmodal"):
        prepare(found, likely_topic_map(found), RecordedRobot(), overrides=[
            "modalities=[mine]", "variants.mine.of=crossmodal"])  # fmt: skip


def test_a_replay_is_repeated_with_a_file_that_is_named_from_anywhere(
    replayed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(replayed)
    found = survey(replayed / "x.bag")
    key = "variants.mine.replacements.camera_motion"
    changes = ["modalities=[mine]", "variants.mine.of=vision", f"{key}=mine.py:Camera"]
    ready = prepare(found, likely_topic_map(found), RecordedRobot(), "wam", changes)
    assert ready.scenario.replay.endswith(f"{key}={replayed / 'mine.py'}:Camera")


def test_a_replay_is_streamed_in_the_recordings_own_times_and_frames(replayed: Path) -> None:
    with open_recording(replayed / "stream.mcap") as stream:
        found = [(each.topic, each.time, each.decode()) for each in stream.messages(stream.topics)]
    (place, *_) = [message.transforms[0] for topic, _, message in found if topic == "/tf"]
    assert (place.header.frame_id, place.child_frame_id) == ("base_link", "optical")
    images = [message.header for topic, _, message in found if topic.endswith("color/image_raw")]
    sent = {header.stamp.sec * 10**9 + header.stamp.nanosec for header in images}
    assert sent
    assert sent <= {START + 33 * MS * k for k in range(6)}
    assert all(START <= time <= START + 1000 * MS for _, time, _ in found)
    result = CliRunner().invoke(app, ["stream", str(replayed / "x.bag"), "--to", "a.mcap"])
    assert result.exit_code == 2
    assert "--stream a.mcap` streams what is perceived in it" in result.stderr


def test_a_replays_folder_holds_what_repeats_it(replayed: Path) -> None:
    out, found = replayed / "out", survey(replayed / "x.bag")
    assert read_topic_map(out / "topics.yaml", found) == likely_topic_map(found)
    robot = read_calibration(out / "calibration.yaml")
    assert (robot.world, robot.errors.camera_rotation) == ("base_link", np.deg2rad(0.5))
    files = json.loads((out / "summary.json").read_text())["files"]
    assert {"topics.yaml", "calibration.yaml"} <= set(files)
    result = CliRunner().invoke(app, ["run", str(out / "scenario.yaml")])
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert f"crossmodal replay {replayed / 'x.bag'} --robot wam --set" in line
    assert line.endswith(f"--calibration {out}/calibration.yaml --topics {out}/topics.yaml")


def test_the_examples_of_the_page_can_be_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/own-recordings.md").read_text()
    topics, calibration = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    made = load_typed(TopicMap, yaml.safe_load(topics), "the page")
    assert len(made.joint_names) == 7
    assert 10.0 in made.held[0]
    (tmp_path / "my.yaml").write_text(calibration)
    robot = read_calibration(tmp_path / "my.yaml")
    assert robot.errors.camera_translation == 0.005


def _shortened(rows: list[Row]) -> None:
    for row in rows[30:]:
        row[2].update({"data": b"12"} if row[0] == COLOR else {})


def _other_encoding(rows: list[Row]) -> None:
    for row in rows[30:]:
        row[2].update({"encoding": "yuv422"} if row[0] == COLOR else {})


def _grey_for_depth(rows: list[Row]) -> None:
    for row in rows[30:]:
        row[2].update({"encoding": "8UC1", "step": WIDTH} if row[0] == DEPTH else {})


def _narrower(rows: list[Row]) -> None:
    for row in rows[30:]:
        row[2].update({"width": 10} if row[0] == COLOR else {})


def _unknown_lens(rows: list[Row]) -> None:
    for row in rows:
        row[2].update({"d": [0.1] * 3} if row[0] == INFOS else {})


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_shortened, "2 bytes with rows of 96 for 32 x 24 pixels of bgr8"),
        (_other_encoding, "the encoding 'yuv422' is no colour image"),
        (_grey_for_depth, "the encoding '8UC1' is no depth image"),
        (_narrower, "choose the topic that is registered"),
        (_unknown_lens, "a distortion of 3 coefficients does not fit plumb_bob"),
    ],
)
def test_images_that_change_on_the_way_end_a_replay_in_one_line_without_a_folder(
    damage: Callable[[list[Row]], None], said: str, tmp_path: Path
) -> None:
    rows = [(topic, kind, dict(fields), time) for topic, kind, fields, time in camera()]
    damage(rows)
    (tmp_path / "my.yaml").write_text("{}")
    options = ["--robot", "wam", "--calibration", str(tmp_path / "my.yaml")]
    path, out = str(bag(tmp_path, rows)), tmp_path / "out"
    result = CliRunner().invoke(app, ["replay", path, *options, "--out", str(out)])
    assert result.exit_code == 2, result.output
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("crossmodal: ")]
    assert said in line
    assert not out.exists()
