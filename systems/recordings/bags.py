"""ROS 1 bags, ROS 2 bags and MCAP files, read by the package rosbags."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from crossmodal.maths.git_lfs import STANDS_FOR_ANOTHER, is_lfs_pointer
from crossmodal.systems.recordings.mcap_check import check_mcap
from crossmodal.systems.recordings.recording import Logged, RecordingError, TopicFacts

FILES = (".bag", ".mcap", ".db3")
_REMEDIES = (
    ("not indexed", "index it by `rosbag reindex FILE`"),
    ("seems to be empty", "it has no bytes; record it again"),
    ("not in timestamp order", "it has no index; mend it by `mcap recover FILE`"),
    ("end magic is invalid", "it was not written to its end; mend it by `mcap recover FILE`"),
    ("index looks damaged", "it was cut off; mend it by `rosbag reindex FILE`"),
    ("Profile is not ros2", "its messages are not of ROS 2; convert it to a ROS 2 bag"),
    ("Could not parse", "a message definition in it is damaged; copy or record it again"),
    ("MemoryError", "a length in it is damaged; copy or record it again"),
    ("hash mismatch", "its message definitions do not fit its messages; convert it by rosbags"),
)


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a file by its ending, a folder by what is in it."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or bool(_files_in(path))
    return path.suffix in FILES


def _files_in(folder: Path) -> list[Path]:
    """The files of a folder without metadata, of the one kind that is there."""
    for ending in FILES:
        if found := sorted(folder.glob(f"*{ending}")):
            return found
    return []


def _is_cut_off(file: Path) -> bool:
    """Whether a database of SQLite is shorter than its header says (sqlite.org/fileformat2.html).

    SQLite itself notices that only when it reads a page that is not there.
    """
    with file.open("rb") as opened:
        head = opened.read(100)
    if not head.startswith(b"SQLite format 3\0") or head[24:28] != head[92:96]:
        return False  # No database, or the count of pages is not valid.
    page, count = (int.from_bytes(head[at : at + size], "big") for at, size in ((16, 2), (28, 4)))
    return file.stat().st_size < (65536 if page == 1 else page) * count


class BagRecording:
    """A bag: a file `.bag`, `.mcap` or `.db3`, a folder of ROS 2, or a folder of split files.

    Raises:
        RecordingError: where it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.name = str(path)
        with_metadata = path.is_dir() and (path / "metadata.yaml").exists()
        paths = _files_in(path) if path.is_dir() and not with_metadata else [path]
        for file in filter(Path.is_file, _files_in(path) if path.is_dir() else [path]):
            if is_lfs_pointer(file):
                raise RecordingError(f"{file}: {STANDS_FOR_ANOTHER}")
            if _is_cut_off(file):
                raise RecordingError(f"{file}: was cut off at its end; copy or record it again")
        # A file of sqlite has no definitions of its messages before ROS 2 Iron.
        store = get_typestore(Stores.ROS2_HUMBLE)
        with self._damage("cannot be read"):
            self._reader = AnyReader(paths, default_typestore=store)
            self._reader.open()
        with self._damage("is damaged"):
            for file in _files_in(path) if path.is_dir() else [path]:
                if file.suffix == ".mcap":
                    check_mcap(file)
        self.topics = {
            name: TopicFacts(name=name, type=facts.msgtype or "", count=facts.msgcount)
            for name, facts in self._reader.topics.items()
            if facts.msgcount
        }

    def messages(self, topics: Collection[str]) -> Iterator[Logged]:
        """Messages of some topics in order of their log times."""
        wanted = set(topics)
        chosen = [each for each in self._reader.connections if each.topic in wanted]
        if not chosen:
            return
        missing = sum(each.msgcount for each in chosen)
        with self._damage("is damaged"):
            for connection, time, raw in self._reader.messages(connections=chosen):
                decode = partial(self._decoded, raw, connection.msgtype, connection.topic)
                missing -= 1
                yield Logged(
                    topic=connection.topic, type=connection.msgtype, time=time, decode=decode
                )

        if missing > 0:
            raise RecordingError(
                f"{self.name}: is damaged: {missing} messages that its index names are not there"
            )

    def _decoded(self, raw: bytes, kind: str, topic: str) -> Any:
        with self._damage(f"'{topic}' holds a message that is no {kind}"):
            return self._reader.deserialize(raw, kind)

    @contextmanager
    def _damage(self, what: str) -> Iterator[None]:
        """Turns whatever the libraries make of a damaged file into one line."""
        try:
            yield
        except (RecordingError, PermissionError, KeyboardInterrupt, GeneratorExit):
            raise
        except Exception as error:  # rosbags, sqlite, lz4, zstd and yaml have errors of their own.
            raise RecordingError(f"{self.name}: {what}: {_said(error)}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._reader.close()


def _said(error: Exception) -> str:
    text = str(error) or type(error).__name__
    remedy = next((remedy for part, remedy in _REMEDIES if part in text), None)
    return text.rstrip(".") if remedy is None else remedy
