"""Files that are written beside their place and moved there when they are whole."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line


def is_within(folder: Path, name: object) -> bool:
    """Whether a path relative to a folder stays in it, and no link leads out of it."""
    if not isinstance(name, str):
        return False
    try:
        path = (folder / name).resolve()
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            path.stat()  # A name may be too long.
        return path.is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # No path can be so, or links lead in a circle.
        return False


def write_atomically(path: Path, write: Callable[[Path], Any]) -> Path:
    """Lets `write` fill a file beside `path`, then moves it there, where an empty folder may be."""
    partial = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(partial)
        with contextlib.suppress(OSError):
            path.rmdir()
        os.replace(partial, path)
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise ScenarioError(f"{path}: cannot be written: {reason}") from None
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_within(folder: Path, name: str, write: Callable[[Path], Any]) -> Path:
    """The same of a file of a folder's own.

    Raises:
        ScenarioError: where a folder in it is a link to somewhere else.
    """
    if not is_within(folder, os.path.dirname(name)):
        raise ScenarioError(f"{folder / name}: a link leads out of {folder}; remove it")
    return write_atomically(folder / name, write)


def write_text(path: Path, text: str) -> Path:
    return write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))
