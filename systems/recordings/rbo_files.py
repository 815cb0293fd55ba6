"""An interaction of the RBO data set of articulated objects in its file form.

A folder has `camera_rgb/*-SECONDS.png`, `camera_depth_registered/*-SECONDS.txt` (a matrix of depths
in metres) and, where they were recorded, `ft_sensor_netft_data.csv` and `*_joint_states.csv` as
`rostopic echo -p` writes them.

Source: R. Martín-Martín, C. Eppner and O. Brock, The RBO dataset of articulated objects and
interactions, IJRR 2019.
"""

import csv
import heapq
from collections.abc import Callable, Collection, Iterator
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any, Self

import numpy as np

from crossmodal.systems.recordings.recording import Logged, RecordingError, TopicFacts

IMAGE, JOINTS = "sensor_msgs/msg/Image", "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
COLOR, DEPTH, FORCES = "camera_rgb", "camera_depth_registered", "ft_sensor_netft_data"
_STAMP_COLUMN, _FIRST_COLUMN = 2, 4


def is_rbo_folder(path: Path) -> bool:
    """Whether a folder is an interaction in file form."""
    return (path / COLOR).is_dir() or (path / DEPTH).is_dir()


class RboRecording:
    """The files of one interaction as topics: `/camera_rgb`, `/camera_depth_registered`, ...

    Raises:
        RecordingError: where a file's name or header is not as the data set has them.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._path = path
        self._sources: dict[str, tuple[str, Callable[[], Iterator[Logged]]]] = {}
        self.topics: dict[str, TopicFacts] = {}
        for folder, ending, read in ((COLOR, ".png", _color), (DEPTH, ".txt", _depth)):
            files = sorted((self._time(file), file) for file in (path / folder).glob(f"*{ending}"))
            if files:
                self._add(
                    f"/{folder}", IMAGE, len(files), partial(self._images, folder, files, read)
                )
        for file in sorted(path.glob("*.csv")):
            kind = WRENCH if file.stem == FORCES else JOINTS
            if kind == JOINTS and not file.stem.endswith("joint_states"):
                continue
            with file.open(newline="") as text:
                count = max(sum(1 for _ in text) - 1, 0)
            if count:
                self._add(f"/{file.stem}", kind, count, partial(self._rows, file, kind))

    def _add(self, name: str, kind: str, count: int, read: Callable[[], Iterator[Logged]]) -> None:
        self._sources[name] = kind, read
        self.topics[name] = TopicFacts(name=name, type=kind, count=count)

    def messages(self, topics: Collection[str]) -> Iterator[Logged]:
        """Messages of some topics in order of their times."""
        chosen = [self._sources[name][1]() for name in sorted(topics) if name in self._sources]
        yield from heapq.merge(*chosen, key=lambda logged: logged.time)

    def _time(self, file: Path) -> int:
        """The stamp in a file's name, [ns]."""
        text = file.stem.rpartition("-")[2]
        try:
            return int(Decimal(text) * 1_000_000_000)
        except (InvalidOperation, ValueError, OverflowError):
            raise RecordingError(
                f"{file}: its name has no time; rename it as in image-1460000000.123.png"
            ) from None

    def _images(
        self, folder: str, files: list[tuple[int, Path]], read: Callable[[Path], Any]
    ) -> Iterator[Logged]:
        for time, file in files:

            def decode(time: int = time, file: Path = file) -> Any:
                image = read(file)
                image.header = _header(time)
                return image

            yield Logged(topic=f"/{folder}", type=IMAGE, time=time, decode=decode)

    def _rows(self, file: Path, kind: str) -> Iterator[Logged]:
        with file.open(newline="") as text:
            rows = csv.reader(text)
            width = len(next(rows))
            for number, row in enumerate(rows, start=2):
                try:
                    time = int(Decimal(row[_STAMP_COLUMN]))
                    if len(row) < width:
                        raise IndexError
                    message = (_wrench if kind == WRENCH else _joints)(row[_FIRST_COLUMN:])
                except (InvalidOperation, ValueError, IndexError):
                    raise RecordingError(
                        f"{file}: row {number} is not as `rostopic echo -p` writes it; mend or"
                        " remove it"
                    ) from None
                message.header = _header(time)
                yield Logged(
                    topic=f"/{file.stem}", type=kind, time=time, decode=partial(_same, message)
                )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass


def _same(message: Any) -> Any:
    return message


def _header(time: int) -> SimpleNamespace:
    seconds, rest = divmod(time, 1_000_000_000)
    return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=rest), frame_id="")


def _image(data: Any, encoding: str) -> SimpleNamespace:
    height, width = data.shape[:2]
    flat = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
    return SimpleNamespace(
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=len(flat) // height,
        data=flat,
    )


def _color(file: Path) -> SimpleNamespace:
    import cv2

    data = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if data is None:
        raise RecordingError(f"{file}: is no image; remove it or unpack the recording again")
    return _image(data, "bgr8")


def _depth(file: Path) -> SimpleNamespace:
    try:
        data = np.loadtxt(file, dtype=np.float32, ndmin=2)
    except ValueError:
        raise RecordingError(
            f"{file}: is no matrix of depths; remove it or unpack the recording again"
        ) from None
    return _image(data, "32FC1")


def _wrench(cells: list[str]) -> SimpleNamespace:
    numbers = [float(cell) for cell in cells[:6]]
    if len(numbers) < 6:
        raise IndexError
    force, torque = (
        SimpleNamespace(**dict(zip("xyz", part, strict=True)))
        for part in (numbers[:3], numbers[3:])
    )
    return SimpleNamespace(wrench=SimpleNamespace(force=force, torque=torque))


def _joints(cells: list[str]) -> SimpleNamespace:
    """Names come first and then as many positions, velocities and efforts."""
    count = 0
    while count < len(cells) and not _is_number(cells[count]):
        count += 1
    if not 0 < 2 * count <= len(cells):
        raise IndexError
    parts = [[float(cell) for cell in cells[k * count : (k + 1) * count]] for k in (1, 2, 3)]
    position, velocity, effort = map(np.array, parts)
    return SimpleNamespace(name=cells[:count], position=position, velocity=velocity, effort=effort)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
