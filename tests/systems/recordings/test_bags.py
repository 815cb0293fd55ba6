"""Bags of all kinds give the same messages; damaged ones are refused in one line."""

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from ros_messages import IMAGE, INFO, START, image, read_all, write_bag

from crossmodal.systems.recordings.camera_info import camera_facts
from crossmodal.systems.recordings.images import color_of
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import RecordingError, stamp_of

S = 1_000_000_000
RGB = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
INFO_FIELDS = {
    "width": 6,
    "height": 4,
    "distortion_model": "plumb_bob",
    "d": [0.0] * 5,
    "k": [5.0, 0.0, 2.5, 0.0, 5.5, 1.5, 0.0, 0.0, 1.0],
    "p": [6.0, 0.0, 2.0, 0.0, 0.0, 6.5, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
}
ROWS = [
    row
    for k in range(4)
    for row in (
        (
            "/camera/image_raw",
            IMAGE,
            image(RGB + np.uint8(k), "rgb8", START + k * S),
            START + k * S,
        ),
        ("/camera/camera_info", INFO, INFO_FIELDS, START + k * S),
    )
]
NAMES = {"bag": "x.bag", "db3": "db3", "mcap": "mcap"}


@pytest.fixture(params=["bag", "db3", "mcap", "single db3", "single mcap", "split", "no metadata"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A recording of each kind."""
    kind = request.param
    if kind == "split":
        for k, rows in enumerate((ROWS[:4], ROWS[4:])):
            (tmp_path / "bags").mkdir(exist_ok=True)
            write_bag(tmp_path / f"bags/{k}.bag", "bag", rows)
        return tmp_path / "bags"
    folder = tmp_path / NAMES[kind.split()[-1] if kind != "no metadata" else "mcap"]
    write_bag(folder, "mcap" if kind == "no metadata" else kind.split()[-1], ROWS)
    if kind == "no metadata":
        (folder / "metadata.yaml").unlink()
    if kind.startswith("single"):
        (file,) = folder.glob(f"*.{kind.split()[-1]}")
        return file
    return folder


def test_every_kind_of_bag_gives_the_same_messages(bag: Path) -> None:
    with open_recording(bag) as recording:
        facts = recording.topics["/camera/image_raw"]
        assert (facts.type, facts.count) == (IMAGE, 4)
        for k, logged in enumerate(recording.messages(["/camera/image_raw"])):
            message = logged.decode()
            assert logged.time == stamp_of(message) == START + k * S
            assert_array_equal(color_of(message), RGB + np.uint8(k))
        info = next(iter(recording.messages(["/camera/camera_info"]))).decode()
    raw = camera_facts(info, is_rectified=False).intrinsics.vector()
    assert_array_equal(raw, [5.0, 5.5, 2.5, 1.5])
    rectified = camera_facts(info, is_rectified=True).intrinsics.vector()
    assert_array_equal(rectified, [6.0, 6.5, 2.0, 1.0])


def _cut(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    for k in range(200, len(data) // 2, 7):
        data[k] ^= 0xFF
    path.write_bytes(bytes(data))


def _unindexed(path: Path) -> None:
    """As a recorder leaves a bag that was killed: the position of the index is zero."""
    data = path.read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:place] + bytes(8) + data[place + 8 :])


def _nothing(path: Path) -> None:
    path.write_bytes(b"")


def _text(path: Path) -> None:
    path.write_text("no bag")


def _no_tables(path: Path) -> None:
    path.unlink()
    sqlite3.connect(path).execute("create table x (y int)").connection.close()


DAMAGES = {
    "cut to 0.95": lambda path: _cut(path, 0.95),
    "cut to a half": lambda path: _cut(path, 0.5),
    "cut to a few bytes": lambda path: _cut(path, 0.02),
    "wrong bytes": _flip,
    "empty": _nothing,
    "text": _text,
}


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_bags_are_refused_in_one_line(kind: str, damage: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / NAMES[kind], kind, ROWS * 20)
    file = path if path.is_file() else next(path.glob(f"*.{kind}"))
    DAMAGES[damage](file)
    for each in {path, file}:
        _refused(each)


def _refused(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read_all(path)
    said = str(caught.value)
    assert str(path) in said
    assert "\n" not in said
    assert "Traceback" not in said
    return said


def test_a_database_without_its_last_page_is_refused(tmp_path: Path) -> None:
    """Whether SQLite notices depends on its version and on what the page held."""
    path = write_bag(tmp_path / "short", "db3", ROWS * 20)
    (file,) = path.glob("*.db3")
    file.write_bytes(file.read_bytes()[:-1])
    assert "was cut off" in _refused(file)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_folder_whose_file_git_lfs_keeps_elsewhere_is_refused(kind: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "elsewhere", kind, ROWS)
    (file,) = path.glob(f"*.{kind}")
    file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    assert "Git LFS" in _refused(path)


def test_an_unindexed_bag_says_how_it_is_indexed(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "x.bag", "bag", ROWS)
    _unindexed(path)
    assert _refused(path).endswith("index it by `rosbag reindex FILE`")


def test_folders_and_databases_without_what_they_need_are_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "lost", "db3", ROWS)
    (file,) = path.glob("*.db3")
    _no_tables(file)
    _refused(file)
    file.unlink()
    assert "missing" in _refused(path)
    (path / "metadata.yaml").write_text("a: [")
    _refused(path)
    (path / "metadata.yaml").write_text("a: 1")
    _refused(path)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    assert "there is no such" in _refused(tmp_path / "none.bag")
    assert "is no recording" in _refused(tmp_path)
    (tmp_path / "x.txt").write_text("text")
    assert "is no recording" in _refused(tmp_path / "x.txt")
    assert "holds no messages" in _refused(write_bag(tmp_path / "x.bag", "bag", []))
    assert "holds no messages" in _refused(write_bag(tmp_path / "x", "mcap", []))
    shutil.rmtree(tmp_path / "x")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"k": [0.0] * 9, "p": [0.0] * 12}, "has no focal length"),
        ({"k": [float("nan")] * 9}, "has no focal length"),
        ({"d": [0.1], "distortion_model": "omni"}, "'omni' is not known"),
        ({"binning_x": 4}, "images of 1 x 4 pixels"),
    ],
)
def test_camera_infos_that_say_nothing_are_refused(change: dict, said: str, tmp_path: Path) -> None:
    rows = [("/info", INFO, INFO_FIELDS | change, START)]
    with open_recording(write_bag(tmp_path / "x.bag", "bag", rows)) as recording:
        (info,) = [logged.decode() for logged in recording.messages(["/info"])]
    with pytest.raises(RecordingError, match=said):
        camera_facts(info, is_rectified=False)
