"""What can happen to a file: it is lost, or something else is in its place."""

import os
import random
from collections.abc import Callable
from pathlib import Path

Damage = Callable[[Path, Path], None]  # Of the first path; the second one is a file elsewhere.


def lose(path: Path, _: Path) -> None:
    path.unlink()


def empty(path: Path, _: Path) -> None:
    path.write_bytes(b"")


def halve(path: Path, _: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def scramble(path: Path, _: Path) -> None:
    path.write_bytes(random.Random(0).randbytes(path.stat().st_size))


def make_a_folder(path: Path, _: Path) -> None:
    path.unlink()
    path.mkdir()


def link_out(path: Path, elsewhere: Path) -> None:
    path.rename(elsewhere)
    path.symlink_to(elsewhere.resolve())


def link_to_itself(path: Path, _: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def make_a_pipe(path: Path, _: Path) -> None:
    path.unlink()
    os.mkfifo(path)


DAMAGES = (lose, empty, halve, scramble, make_a_folder, link_out, link_to_itself, make_a_pipe)
