"""Poses in bags become the tracks that text files give, and the joints that they show."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from ros_messages import START, Row, header, pose, transform, write_bag
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from crossmodal import joints
from crossmodal.diagrams.command_line import app

COUNT = 90
ANGLES = np.linspace(0.0, 1.2, COUNT)
NOISE = np.random.default_rng(0).normal(scale=5e-4, size=(COUNT, 3))
P = np.column_stack([0.4 * np.cos(ANGLES), 0.4 * np.sin(ANGLES), np.full(COUNT, 0.7)]) + NOISE
Q = Rotation.from_rotvec(np.outer(ANGLES, [0.0, 0.0, 1.0])).as_quat()
TIMES = START + np.arange(COUNT) * 66_666_667
STILL = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])


def rows(kind: str, topic: str = "/door") -> list[Row]:
    made = []
    for k, time in enumerate(map(int, TIMES)):
        stamp: dict = {"header": header(time, "map"), "child_frame_id": "door"}
        moved, still = {"transform": transform(P[k], Q[k])}, {"transform": transform(*STILL)}
        with_covariance = {"pose": pose(P[k], Q[k])}
        table = stamp | {"child_frame_id": "table"} | still
        stamped = {
            "geometry_msgs/msg/PoseStamped": stamp | {"pose": pose(P[k], Q[k])},
            "geometry_msgs/msg/PoseWithCovarianceStamped": stamp
            | {"pose": {"pose": pose(P[k], Q[k])}},
            "geometry_msgs/msg/TransformStamped": stamp | moved,
            "geometry_msgs/msg/PointStamped": stamp | {"point": pose(P[k])["position"]},
            "nav_msgs/msg/Odometry": stamp | {"pose": with_covariance},
            "tf2_msgs/msg/TFMessage": {"transforms": [stamp | moved, table]},
        }
        plain = {
            "geometry_msgs/msg/Pose": pose(P[k], Q[k]),
            "geometry_msgs/msg/PoseWithCovariance": with_covariance,
            "geometry_msgs/msg/Transform": moved["transform"],
            "geometry_msgs/msg/Point": pose(P[k])["position"],
        }
        late = 3_000_000 if kind in stamped else 0  # Without a stamp it counts when it was logged.
        made.append((topic, kind, (stamped | plain)[kind], time + late))
    return made


KINDS = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/Pose",
    "geometry_msgs/msg/PoseWithCovariance",
    "geometry_msgs/msg/Transform",
)


@pytest.mark.parametrize("ending", ["bag", "mcap", "db3"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_pose_is_read_exactly(kind: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / ("x.bag" if ending == "bag" else "x")
    track = joints.read_track(write_bag(path, ending, rows(kind)))
    assert_allclose(track.times, 1e-9 * TIMES, atol=1e-6)
    assert_allclose(track.X_AB[:, :3, 3], P, atol=1e-12)
    assert_allclose(track.X_AB[:, :3, :3], Rotation.from_quat(Q).as_matrix(), atol=1e-9)


@pytest.mark.parametrize("kind", ["geometry_msgs/msg/PointStamped", "geometry_msgs/msg/Point"])
def test_points_have_no_rotations(kind: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "x.bag", "bag", rows(kind))
    assert not joints.read_track(path).has_rotations


def command(*options: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["joints", *map(str, options)])
    assert result.exit_code == code, result.output
    return result.output


def test_the_command_finds_the_hinge_in_a_bag(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "x.bag", "bag", rows(KINDS[0]))
    out = tmp_path / "out"
    command(path, "--out", out)
    found = yaml.safe_load((out / "joint.yaml").read_text())
    assert found["type"] in ("revolute", "screw")
    times = np.loadtxt(out / "configuration.csv", delimiter=",", skiprows=1, usecols=0)
    assert times[0] == 0.0


def _moved(k: int) -> tuple[np.ndarray, Rotation]:
    """The parent's pose: it drives and turns."""
    return np.array([0.01 * k, 0.02 * k, 0.0]), Rotation.from_rotvec([0.0, 0.0, 0.01 * k])


@pytest.mark.parametrize("files", [1, 2])
def test_a_parent_that_moves_is_in_the_same_bag_or_in_another(files: int, tmp_path: Path) -> None:
    kind, child, parent = KINDS[0], [], []
    for k, time in enumerate(map(int, TIMES)):
        p, R = _moved(k)
        door = pose(p + R.apply(P[k]), (R * Rotation.from_quat(Q[k])).as_quat())
        child.append(("/door", kind, {"header": header(time), "pose": door}, time))
        base = {"header": header(time), "pose": pose(p, R.as_quat())}
        # In a bag of its own it is recorded for longer.
        parent.append(("/cart", kind, base, time))
    options = ["--topic", "/door", "--parent-topic", "/cart", "--out", tmp_path / "out"]
    if files == 1:
        both = sorted([*child, *parent], key=lambda row: row[3])
        options += [write_bag(tmp_path / "x.bag", "bag", both)]
    else:
        other = write_bag(tmp_path / "parent.bag", "bag", parent)
        options += [write_bag(tmp_path / "x.bag", "bag", child[5:]), "--parent", other]
    command(*options)
    found = yaml.safe_load((tmp_path / "out/joint.yaml").read_text())
    assert found["type"] in ("revolute", "screw")
    limits = found["limits_seen"]
    assert limits[1] - limits[0] == pytest.approx(1.2 if files == 1 else 1.13, abs=0.03)


def test_out_of_order_stamps_are_sorted_and_a_clock_that_is_set_goes_on(tmp_path: Path) -> None:
    mixed = rows(KINDS[0])
    mixed[10][2]["header"], mixed[11][2]["header"] = mixed[11][2]["header"], mixed[10][2]["header"]
    for k in range(50, COUNT):
        mixed[k][2]["header"] = header(int(TIMES[k]) - START + 5_000_000_000)
    track = joints.read_track(write_bag(tmp_path / "x.bag", "bag", mixed))
    assert_allclose(np.diff(track.times), 1 / 15, atol=0.004)


@pytest.mark.parametrize(
    ("topics", "options", "said"),
    [
        ([("/a", KINDS[0]), ("/b", KINDS[0])], [], "choose one of its poses by --topic: /a, /b"),
        ([("/tf", KINDS[4])], ["--topic", "/tf:cup"], "choose one .*: /tf:door, /tf:table"),
        ([("/a", KINDS[0])], ["--topic", "/c"], "'/c' is no topic of poses; has /a"),
        ([("/a", KINDS[0])], ["--rate", "5"], "a rate name nothing"),
        ([("/a", KINDS[0])], ["--parent-topic", "/c"], "'/c' is no topic of poses"),
        ([], [], "holds no messages"),
    ],
)
def test_what_cannot_be_chosen_is_said_in_one_line(
    topics: list, options: list, said: str, tmp_path: Path
) -> None:
    made = [row for topic, kind in topics for row in rows(kind, topic)]
    path = write_bag(tmp_path / "x.bag", "bag", sorted(made, key=lambda row: row[3]))
    message = command(path, *options, "--out", tmp_path / "out", code=2)
    assert message.count("\n") == 1

    assert re.search(said, message), message


def test_one_of_tfs_frames_moves_and_is_taken_and_another_can_be_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "x.bag", "bag", rows(KINDS[4], "/tf"))
    assert_allclose(joints.read_track(path).X_AB[:, :3, 3], P, atol=1e-12)
    still = joints.read_track(path, topic="/tf:table")
    assert_allclose(still.X_AB[:, :3, 3], 0.0)


def test_joints_are_imported_without_drake_torch_and_rosbags() -> None:
    code = (
        "import sys; from crossmodal import joints;"
        "print(*({'pydrake', 'torch', 'rosbags', 'cv2', 'apsw'} & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not found.stdout.strip()
