"""Tracks in files: CSV with a header, TUM trajectories, plain columns of numbers, and ROS bags."""

import codecs
import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.git_lfs import STANDS_FOR_ANOTHER, is_lfs_pointer
from crossmodal.systems.pose_tracks.pose_track import (
    PoseTrack,
    in_seconds,
    pose_track,
    refuse_unusable,
)
from crossmodal.systems.recordings.open_recording import is_recording
from crossmodal.systems.recordings.pose_topics import read_poses

# What columns are called, the last part of their names, in lower case and without underscores.
_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "secs", "sec", "seconds"),
    "x": ("x", "px", "tx", "posx", "positionx", "translationx"),
    "y": ("y", "py", "ty", "posy", "positiony", "translationy"),
    "z": ("z", "pz", "tz", "posz", "positionz", "translationz"),
    "qx": ("qx", "rotx", "quatx", "orientationx", "rotationx"),
    "qy": ("qy", "roty", "quaty", "orientationy", "rotationy"),
    "qz": ("qz", "rotz", "quatz", "orientationz", "rotationz"),
    "qw": ("qw", "rotw", "quatw", "orientationw", "rotationw", "w"),
}
# Parts of names of what is no position, although it ends like one.
_NO_POSITION = {
    *("orientation", "rotation", "rot", "quat", "q", "velocity", "vel", "v", "linear", "angular"),
    *("acceleration", "acc", "a", "twist", "force", "torque", "covariance", "cov"),
}
_FRACTION = ("nsecs", "nsec", "nanosec", "nanosecs", "nanoseconds")  # Beside a column of seconds.
_POSITION, _QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # As in `time_ms`.
_LARGEST_FILE = 500_000_000  # [bytes]


def read_track(
    path: Path,
    *,
    columns: Mapping[str, str] | None = None,
    rate: float | None = None,
    scale: float = 1.0,
    time_scale: float = 1.0,
    topic: str = "",
) -> PoseTrack:
    """The poses of a file, at the times that it says, [s].

    - A CSV file with a header: columns of time, position and quaternion are found by their names,
      such as `t`, `time_ms`, `x`, `qw` or `field.pose.position.x`.
    - A TUM trajectory: `t x y z qx qy qz qw`, without a header.
    - Columns of numbers `t x y z`, or, with a rate, `x y z` or `x y z qx qy qz qw`.
    - A ROS 1 bag, a ROS 2 bag or an MCAP file with stamped poses or transforms, odometry or TF.

    Stamps in milli-, micro- or nanoseconds since 1970 are recognised.

    Args:
        path: A bag, or a text file, whose columns are separated by commas, semicolons or blanks;
            `#` begins a comment.
        columns: Names of columns by `time`, `x`, `y`, `z`, `qx`, `qy`, `qz`, `qw`, where they are
            not found.
        rate: Of the poses, [Hz], where the file has no times; else they are not used.
        scale: Metres per unit of the positions; 0.001 for millimetres.
        time_scale: Seconds per unit of the times, as long as they are not since 1970.
        topic: Of a bag with several topics of poses; of TF `TOPIC:CHILD`, a frame in its parent.

    Raises:
        ValueError: for a file that is none of these, or has less than two poses that can be used,
            in one line that names it.
        OSError: where it cannot be read.
    """
    for name, value in (("scale", scale), ("time scale", time_scale)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value:g}, need above 0")
    if is_recording(path):
        if columns or rate is not None:
            raise ValueError(f"{path}: is a bag, in which columns and a rate name nothing")
        stamps, found_poses = read_poses(path, topic)
        refuse_unusable(stamps, found_poses, str(path))
        found_poses[:, :3] *= scale
        return pose_track(stamps, found_poses)
    if path.is_dir():
        raise ValueError(f"{path}: is a folder without a recording; name a file")
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    if path.name == "metadata.yaml":
        raise ValueError(f"{path}: describes a ROS 2 bag; name its folder, {path.parent}")
    if topic:
        raise ValueError(f"{path}: is no bag, so that it has no topic '{topic}'")
    if path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"{path}: is larger than {_LARGEST_FILE / 1e6:.0f} MB")
    if is_lfs_pointer(path):
        raise ValueError(f"{path}: {STANDS_FOR_ANOTHER}")
    lines = _text(path).splitlines()
    rows = {k: line.split("#", 1)[0] for k, line in enumerate(lines, 1)}
    rows = {k: row for k, row in rows.items() if row.strip()}
    if not rows:
        raise ValueError(f"{path}: has no poses")
    notes = []
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise ValueError(f"rate = {rate:g} Hz, need above 0")
    whole = list(rows.values())[-2:][0]  # The last row may be cut short.
    separator = next((mark for mark in ";\t," if mark in whole), None)
    cells = [_split(row, separator) for row in rows.values()]
    header, numbers, cells = _header(list(rows), cells)
    if len(cells) > 1 and len(cells[-1]) < len(cells[-2]):
        notes.append(f"line {numbers.pop()} is cut short, and was not used")
        cells.pop()
    table = _numbers(path, cells, numbers)
    if header is None and columns:
        raise ValueError(f"{path}: has no header, so that columns cannot be named")
    if header:
        found = _by_name(path, header, columns or {}, notes)
        data = {name: table[:, index] for name, index in found.items()}
        rotations = all(name in data for name in _QUATERNION)
        times = data.get("time")
        if times is not None:
            time_scale *= _TIME_UNITS.get(_parts(header[found["time"]])[-1], 1.0)
        fraction = next(
            (i for i, name in enumerate(header) if name.lower().endswith(_FRACTION)), None
        )
        if times is not None and fraction not in (None, found["time"]):
            times = times + 1e-9 * table[:, fraction]
        names = (*_POSITION, *_QUATERNION) if rotations else _POSITION
        poses = np.column_stack([data[name] for name in names])
        unused = [name for index, name in enumerate(header) if index not in found.values()]
        if unused and not rotations:
            notes.append(
                f"no rotations were read, which are quaternions qx, qy, qz, qw; not used:"
                f" {', '.join(unused)}"
            )
    else:
        times, poses = _by_count(path, table, rate)
    if times is not None and rate is not None:
        times = None
        notes.append(f"the times in {path} are not used, since a rate is given")
    if times is None:
        if rate is None:
            has = f"has {', '.join(header or [])}. " if header else ""
            raise ValueError(
                f"{path}: no column is the time; {has}Name it, as in --columns time=NAME, or give"
                " the --rate"
            )
        times = np.arange(len(poses)) / rate
    refuse_unusable(times, poses, str(path), numbers)
    poses[:, :3] *= scale
    return replace(pose_track(in_seconds(times, time_scale), poses), notes=tuple(notes))


def _text(path: Path) -> str:
    """What is written in a file, in UTF-8, UTF-16 or, as older programs write it, in Latin-1."""
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data:
        raise ValueError(
            f"{path}: is no text; tracks are CSV or TUM files, or bags: .bag, .mcap, .db3"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _header(
    lines: list[int], cells: list[list[str]]
) -> tuple[list[str] | None, list[int], list[list[str]]]:
    """Names of the columns, or None, and lines and cells of what follows them.

    Before the first row of numbers there may be several rows of text. Those with as many cells
    name the columns together, as where motion capture writes "Rotation" above "X".
    """
    first = next((k for k, row in enumerate(cells) if _are_numbers(row)), min(1, len(cells)))
    width = len(cells[first]) if first < len(cells) else len(cells[0])
    names = [row for row in cells[:first] if len(row) == width]
    header = [".".join(filter(None, column)) for column in zip(*names, strict=True)]
    return header or None, lines[first:], cells[first:]


def _split(row: str, separator: str | None) -> list[str]:
    if separator is None:
        return row.split()
    return [cell.strip() for cell in next(csv.reader([row], delimiter=separator))]


def _are_numbers(cells: Sequence[str]) -> bool:
    try:
        [float(cell) for cell in cells if cell]
    except ValueError:
        return False
    return any(cells)


def _numbers(path: Path, rows: Sequence[Sequence[str]], lines: Sequence[int]) -> Array:
    """The table (N, columns) of what is in these lines; cells without a number are NaN.

    Raises:
        ValueError: where rows have different lengths, or no row has a number.
    """
    if not rows:
        raise ValueError(f"{path}: has a header and no poses")
    width = len(rows[0])
    table = np.full((len(rows), width), np.nan)
    for k, row in enumerate(rows):
        if len(row) != width:
            raise ValueError(f"{path}: line {lines[k]} has {len(row)} columns, others have {width}")
        for column, cell in enumerate(row):
            try:
                table[k, column] = float(cell)
            except ValueError:
                continue
    if not np.isfinite(table).any():
        raise ValueError(
            f"{path}: has no numbers; line {lines[0]} begins with '{rows[0][0]}', where a number"
            " with a decimal point was expected"
        )
    return table


def _by_name(
    path: Path, header: Sequence[str], given: Mapping[str, str], notes: list[str]
) -> dict[str, int]:
    """Index of each column by what it is, with a note where others could be meant."""
    unknown = sorted(set(given) - set(_NAMES))
    if unknown:
        raise ValueError(f"'{unknown[0]}' is no column of a track; there are {', '.join(_NAMES)}")
    found = {}
    for name, usual in _NAMES.items():
        if name in given:
            if given[name] not in header:
                raise ValueError(f"{path}: has no column '{given[name]}'; has {', '.join(header)}")
            found[name] = header.index(given[name])
            continue
        possible = []
        for index, column in enumerate(header):
            parts = _parts(column)
            if name == "time" and len(parts) > 1 and parts[-1] in _TIME_UNITS:
                parts.pop()
            endings = {"".join(parts[-k:]) for k in (1, 2)}
            if name in _POSITION and _NO_POSITION & set(parts[:-1]):
                continue
            if endings & set(usual) and index not in found.values():
                possible.append(index)
        if possible:
            found[name] = possible[0]
            names = [header[index] for index in possible]
            if len(set(names)) < len(names):
                raise ValueError(
                    f"{path}: several columns are called '{names[0]}'; give them names in the file"
                )
            if len(names) > 1 and name in _POSITION:
                notes.append(f"{name} is '{names[0]}', not {', '.join(names[1:])} (--columns)")
    missing = [name for name in _POSITION if name not in found]
    if missing:
        raise ValueError(
            f"{path}: no column is {missing[0]}; has {', '.join(header)}. Name them, as in"
            f" --columns {missing[0]}=NAME"
        )
    return found


def _parts(column: str) -> list[str]:
    """Of a column's name, in lower case."""
    return [part for part in re.split(r"[^a-z0-9]+", column.lower()) if part]


def _by_count(path: Path, table: Array, rate: float | None) -> tuple[Array | None, Array]:
    """Times and poses of a table without a header."""
    width = table.shape[1]
    if rate is not None and width in (3, 7, 9):
        return None, table[:, : min(width, 7)].copy()
    if width in (4, 8):
        return table[:, 0], table[:, 1:].copy()
    if rate is None and width in (3, 7):
        raise ValueError(f"{path}: has {width} columns and so no times; give the rate")
    raise ValueError(
        f"{path}: has {width} columns and no header; need t x y z qx qy qz qw, t x y z, or with a"
        " rate x y z or x y z qx qy qz qw"
    )
