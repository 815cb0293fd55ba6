"""Which files in a folder are a run's: no others are ever replaced or removed.

A run says in a file beside them which files it is going to write, before it writes them, so that
also what a killed run has left behind is known. The same file is locked while a run goes on; the
lock ends with its process.
"""

import contextlib
import fcntl
import glob
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import TextIO

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

MANIFEST = ".run-files"  # A JSON string in each line: a path relative to the folder.


class OwnFiles:
    """The files of a folder that are a run's, by their paths relative to it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._manifest = folder / MANIFEST

    @property
    def names(self) -> list[str]:
        """Those that runs have written here, or were about to."""
        return _read(self._manifest)

    def place(self, name: str) -> Path:
        """Where a run may write a file, which is its own from now on.

        Raises:
            ScenarioError: where a file is that no run has written.
        """
        path = self._folder / name
        if name not in self.names:
            if os.path.lexists(path):
                raise ScenarioError(
                    f"{path}: is no file of an earlier run and is not replaced;"
                    " move it away or choose another folder with --out"
                )
            self.adopt(name)
        return path

    def adopt(self, name: str) -> None:
        """Counts a file as the run's whether it is there already or not."""
        if name in self.names:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with self._manifest.open("a", encoding="utf-8") as manifest:
                manifest.write(_line(name))
        except OSError as error:
            path, reason = self._folder / name, error.strerror or error
            raise ScenarioError(f"{path}: cannot be written: {reason}") from None

    def remove_all_but(self, kept: Iterable[str]) -> None:
        """Removes and forgets the run's other files, and folders that are empty then."""
        kept = set(kept)
        names = self.names
        others = [name for name in names if name not in kept]
        for name in others:
            path = self._folder / name
            if not path.parent.resolve().is_relative_to(self._folder.resolve()):
                continue  # A link leads out of the folder.
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                for parent in PurePosixPath(name).parents[:-1]:
                    (self._folder / parent).rmdir()
        if others:
            # In its place, since it is locked, and on a full disk there is no other.
            with self._manifest.open("r+", encoding="utf-8") as manifest:
                manifest.write("".join(_line(name) for name in names if name in kept))
                manifest.truncate()

    def remove_partial(self) -> None:
        """Removes what writers that were killed have left of their files."""
        for name in self.names:
            path = self._folder / name
            for partial in path.parent.glob(f".[0-9]*-{glob.escape(path.name)}"):
                partial.unlink(missing_ok=True)


def _line(name: str) -> str:
    return json.dumps(name) + "\n"


def _read(manifest: Path) -> list[str]:
    names = []
    with contextlib.suppress(OSError, UnicodeDecodeError):
        for line in manifest.read_text(encoding="utf-8").splitlines():
            with contextlib.suppress(ValueError):
                name = json.loads(line)
                if isinstance(name, str) and _is_below(PurePosixPath(name)):
                    names.append(name)
    return list(dict.fromkeys(names))


def _is_below(path: PurePosixPath) -> bool:
    return not path.is_absolute() and ".." not in path.parts and path.parts != ()


@contextlib.contextmanager
def held(
    folder: Path, names: Sequence[str], *, force: bool = False, shared: bool = False
) -> Iterator[OwnFiles]:
    """Holds a folder for one run, before anything is computed; one left empty is removed again.

    An evaluation holds its folder as a run does.

    Args:
        folder: Made where it is missing.
        names: Files that the run is going to write.
        force: Whether it may replace the files of an earlier run; others stay in any case.
        shared: Whether it goes on beside what the folder holds already; also then only files of
            an earlier run are replaced.

    Raises:
        ScenarioError: where it cannot be written, another run holds it, or it holds something that
            must not be replaced.
    """
    try:
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        lock = _lock(folder)
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror or error}") from None
    with lock:
        own = OwnFiles(folder)
        try:
            own.remove_partial()
            if not shared:
                _refuse_occupied(folder, own, force)
            _refuse_foreign(folder, own, names)
            for name in names:
                own.adopt(name)
            yield own
        finally:
            if not any((folder / name).exists() for name in own.names):
                (folder / MANIFEST).unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                for path in made:
                    path.rmdir()


def _lock(folder: Path) -> TextIO:
    path = folder / MANIFEST
    while True:
        file = path.open("a", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise ScenarioError(
                f"{folder}: another run is writing there; wait for its end, or choose another"
                " folder with --out"
            ) from None
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()  # The one who held it has removed it.


def _refuse_occupied(folder: Path, own: OwnFiles, force: bool) -> None:
    occupied = any(path.name != MANIFEST for path in folder.iterdir())
    if occupied and not force:
        raise ScenarioError(
            f"{folder}: already holds files; choose another folder with --out,"
            " or replace an earlier run there with --force"
        )
    if occupied and not own.names:
        raise ScenarioError(
            f"{folder}: holds files, but no run that --force could replace; choose another folder"
            " with --out"
        )


def _refuse_foreign(folder: Path, own: OwnFiles, names: Sequence[str]) -> None:
    for name in names:
        if name not in own.names and os.path.lexists(folder / name):
            raise ScenarioError(
                f"{folder / name}: is no file of the earlier run and is not replaced; move it away"
                " or choose another folder with --out"
            )
