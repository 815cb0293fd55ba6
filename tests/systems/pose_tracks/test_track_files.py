"""Tracks in the files that trackers write, and what is refused in one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal import joints

T = np.array([0.0, 0.1, 0.2, 0.3])
P = np.array([[0.1, 0.2, 0.3], [0.2, 0.2, 0.3], [0.3, 0.2, 0.3], [0.4, 0.2, 0.3]])
Q = Rotation.from_rotvec([[0.0, 0.0, 0.1 * k] for k in range(4)]).as_quat()
STAMP = 1_700_000_000.0


def _rows(*columns: np.ndarray, separator: str = " ") -> str:
    table = np.column_stack(columns)
    return "\n".join(separator.join(f"{value:.17g}" for value in row) for row in table) + "\n"


def _csv(header: str, *columns: np.ndarray, separator: str = ",") -> str:
    return header + "\n" + _rows(*columns, separator=separator)


TUM = _rows(T + STAMP, P, Q)
FORMS: dict[str, tuple[str, dict]] = {
    "tum": ("# t x y z qx qy qz qw\n" + TUM, {}),
    "tum with byte order mark and carriage returns": ("\ufeff" + TUM.replace("\n", "\r\n"), {}),
    "csv": (_csv("t,x,y,z,qx,qy,qz,qw", T, P, Q), {}),
    "milliseconds by name": (_csv("time_ms,x,y,z,qx,qy,qz,qw", 1e3 * T, P, Q), {}),
    "milliseconds as said": (
        _csv("t,x,y,z,qx,qy,qz,qw", 1e3 * T, P, Q),
        {"time_scale": 1e-3},
    ),
    "capitals, semicolons, w first": (
        _csv("Time;QW;QX;QY;QZ;X;Y;Z", T, Q[:, 3:], Q[:, :3], P, separator=";"),
        {},
    ),
    "rostopic echo -p": (
        _csv(
            "%time,field.header.seq,field.header.stamp,field.header.frame_id,"
            "field.pose.position.x,field.pose.position.y,field.pose.position.z,"
            "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,"
            "field.pose.orientation.w",
            1e9 * (T + STAMP),
            np.arange(4),
            1e9 * (T + STAMP),
            np.zeros(4),
            P,
            Q,
        ),
        {},
    ),
    "seconds and nanoseconds": (
        _csv(
            "header.stamp.sec,header.stamp.nanosec,velocity.x,position.x,position.y,position.z,"
            "orientation.x,orientation.y,orientation.z,orientation.w",
            np.full(4, STAMP),
            np.round(1e9 * T),
            np.ones(4),
            P,
            Q,
        ),
        {},
    ),
    "milliseconds and millimetres": (
        _csv("timestamp,tx,ty,tz,rot_x,rot_y,rot_z,rot_w", 1e3 * (T + STAMP), 1e3 * P, Q),
        {"scale": 1e-3},
    ),
    "names of one's own": (
        _csv("when,a,b,c,d,e,f,g", T, P, Q),
        {
            "columns": dict(
                zip(
                    ("time", "x", "y", "z", "qx", "qy", "qz", "qw"),
                    ("when", *"abcdefg"),
                    strict=True,
                )
            )
        },
    ),
    "a rate for times": (_rows(P, Q), {"rate": 10.0}),
    "motion capture": (
        "Format Version,1.23,Take Name,door\n\n,Type"
        + 7 * ",Rigid Body"
        + "\n,Name"
        + 7 * ",door"
        + "\n,,"
        + 4 * "Rotation,"
        + "Position,Position,Position\n"
        + _csv("Frame,Time (Seconds),X,Y,Z,W,X,Y,Z", np.arange(4), T, Q, P),
        {},
    ),
    "a last line that was cut short": (_csv("t,x,y,z,qx,qy,qz,qw", T, P, Q) + "0.4,0.5,0", {}),
    "a last line of which hardly anything is left": (
        _csv("t,x,y,z,qx,qy,qz,qw", T, P, Q) + "0",
        {},
    ),
    "tabs": (_csv("t\tx\ty\tz\tqx\tqy\tqz\tqw", T, P, Q, separator="\t"), {}),
}


@pytest.mark.parametrize("name", FORMS)
def test_all_forms_of_a_track_give_the_same_poses(tmp_path: Path, name: str) -> None:
    text, options = FORMS[name]
    path = tmp_path / "track.txt"
    path.write_text(text)
    track = joints.read_track(path, **options)
    assert_allclose(track.times - track.times[0], T, atol=1e-5)
    assert_allclose(track.X_AB[:, :3, 3], P, atol=1e-9)
    assert_allclose(track.X_AB[:, :3, :3], Rotation.from_quat(Q).as_matrix(), atol=1e-9)
    assert track.has_rotations


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_columns_may_have_names_of_any_encoding(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "track.csv"
    path.write_text(_csv("t,x,y,z,Öffnung [°]", T, P, T), encoding=encoding)
    assert_allclose(joints.read_track(path).X_AB[:, :3, 3], P)


def test_what_of_a_file_was_not_used_is_told(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text(_csv("t,hand.x,hand.y,hand.z,lid.x,lid.y,lid.z", T, P, P) + "0.4,0.5")
    notes = " ".join(joints.read_track(path, rate=5.0).notes)
    assert "line 6 is cut short" in notes
    assert "x is 'hand.x', not lid.x" in notes
    assert "the times in" in notes
    assert_allclose(joints.read_track(path, rate=5.0).times, 2.0 * T)


@pytest.mark.parametrize(
    "text", [_rows(T, P), _csv("t,x,y,z", T, P), _csv("time,p_x,p_y,p_z,speed", T, P, T)]
)
def test_positions_alone_have_no_rotations(tmp_path: Path, text: str) -> None:
    path = tmp_path / "track.csv"
    path.write_text(text)
    track = joints.read_track(path)
    assert_allclose(track.X_AB[:, :3, 3], P)
    assert not track.has_rotations


def test_cells_without_a_number_are_missing_poses(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text("t,x,y,z\n0,1,2,3\n1,,2,3\n2,n/a,2,3\n3,1,2,3\n")
    X = joints.read_track(path).X_AB
    assert np.isfinite(X).all(axis=(1, 2)).tolist() == [True, False, False, True]


def _binary(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("", {}, "has no poses"),
        ("# only a comment\n", {}, "has no poses"),
        ("t,x,y,z\n", {}, "a header and no poses"),
        ("t,x,y,z\na,b,c,d\n", {}, "has no numbers; line 2 begins with 'a'"),
        ("t,x,y,z\n1,2,3,4\n", {}, "one pose shows no joint"),
        (
            _csv("# By hand\n\nt,x,y,z,qx,qy,qz,qw", T, P, 3.0 * Q),
            {},
            "in 4 of 4, first in line 4, the quaternion has norm 3 instead of 1; divide quaternion",
        ),
        (_csv("t,x,y,z", T * np.nan, P), {}, "in 4 of 4, first in line 2, time is no number"),
        ("1 2 3 4 5\n", {}, "has 5 columns and no header"),
        ("1 2 3\n", {}, "no times; give the rate"),
        ("1 2 3 4\n1 2 3\n1 2 3 4\n", {}, "line 2 has 3 columns, others have 4"),
        ("t,X,Y,Z,X,Y,Z\n1,2,3,4,5,6,7\n", {}, "several columns are called 'X'"),
        ("t,x,y\n1,2,3\n", {}, "no column is z; has t, x, y"),
        ("x,y,z\n1,2,3\n", {}, "no column is the time; has x, y, z. Name it"),
        ("t,x,y,z\n1,2,3,4\n", {"columns": {"x": "px"}}, "no column 'px'"),
        ("t,x,y,z\n1,2,3,4\n", {"columns": {"u": "x"}}, "'u' is no column of a track"),
        ("1 2 3 4\n", {"columns": {"x": "px"}}, "has no header"),
        ("1 2 3\n", {"rate": 0.0}, "rate = 0 Hz"),
        ("1 2 3 4\n", {"scale": float("nan")}, "scale = nan"),
        (_binary, {}, "is no text"),
        (lambda path: path.mkdir(), {}, "is a folder without a recording"),
        (lambda path: None, {}, "there is no such file"),
    ],
)
def test_what_is_no_track_is_refused_in_one_line(
    tmp_path: Path, text: str | Callable[[Path], None], options: dict, message: str
) -> None:
    path = tmp_path / "track.csv"
    if callable(text):
        text(path)
    else:
        path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        joints.read_track(path, **options)
    assert "\n" not in str(caught.value)
