"""An interaction of the RBO data set in its file form reads like a bag."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from ros_messages import read_all

from crossmodal.systems.recordings.images import color_of, depth_of
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.recording import RecordingError, stamp_of

RGB = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
DEPTH = np.array([[0.5, 0.0, np.nan], [1.0, 2.0, 3.0]])
STAMPS = ["1460000000.50", "1460000000.533333333"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("camera_rgb", "camera_depth_registered"):
        (tmp_path / name).mkdir()
    for k, stamp in enumerate(STAMPS):
        image = tmp_path / f"camera_rgb/a-file-{k}-{stamp}.png"
        cv2.imwrite(str(image), RGB[:, :, ::-1])
        np.savetxt(tmp_path / f"camera_depth_registered/d-{stamp}.txt", DEPTH)
    (tmp_path / "ft_sensor_netft_data.csv").write_text(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,fx,fy,fz,tx,ty,tz\n"
        "1,0,1460000000400000000,f,1,2,3,4,5,6\n"
        "1,1,1460000000600000000,f,1.5,2,3,4,5,6\n"
    )
    (tmp_path / "book_joint_states.csv").write_text(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,field.name1,"
        "field.position0,field.position1\n"
        "1,0,1460000000510000000,f,hinge,slide,0.1,0.2\n"
    )
    (tmp_path / "notes.csv").write_text("nothing\n1\n")
    return tmp_path


def test_all_streams_are_read_in_order_of_time(folder: Path) -> None:
    with open_recording(folder) as recording:
        assert {name: facts.count for name, facts in recording.topics.items()} == {
            "/camera_rgb": 2,
            "/camera_depth_registered": 2,
            "/ft_sensor_netft_data": 2,
            "/book_joint_states": 1,
        }
        read = [(logged, logged.decode()) for logged in recording.messages(recording.topics)]
    times = [logged.time for logged, _ in read]
    assert times == sorted(times)
    assert times == [stamp_of(message) for _, message in read]
    of = {logged.topic: message for logged, message in read}
    assert_array_equal(color_of(of["/camera_rgb"]), RGB)
    assert stamp_of(of["/camera_rgb"]) == 1_460_000_000_533_333_333
    assert_allclose(depth_of(of["/camera_depth_registered"]), np.nan_to_num(DEPTH))
    wrench = of["/ft_sensor_netft_data"].wrench
    assert (wrench.force.x, wrench.torque.z) == (1.5, 6.0)
    joints = of["/book_joint_states"]
    assert dict(zip(joints.name, joints.position, strict=True)) == {"hinge": 0.1, "slide": 0.2}


def _rename(folder: Path) -> None:
    next((folder / "camera_rgb").iterdir()).rename(folder / "camera_rgb/image.png")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_rename, "its name has no time"),
        (
            lambda folder: next((folder / "camera_rgb").iterdir()).write_text("no image"),
            "is no image",
        ),
        (
            lambda folder: next((folder / "camera_depth_registered").iterdir()).write_text("1 a"),
            "is no matrix of depths",
        ),
        (
            lambda folder: (folder / "ft_sensor_netft_data.csv").write_text("a,b\n1,2\n"),
            "row 2 is not as `rostopic echo -p` writes it",
        ),
    ],
)
def test_files_that_are_not_as_the_data_set_has_them_are_refused(
    folder: Path, damage: object, said: str
) -> None:
    damage(folder)  # type: ignore[operator]
    with pytest.raises(RecordingError, match=said):
        read_all(folder)
