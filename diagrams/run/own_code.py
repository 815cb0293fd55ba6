"""What code of a user's own raises, told by file and line."""

import sysconfig
import traceback
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import TracebackType

from crossmodal.diagrams.run.yaml_input.schema import one_line

GROUP = "crossmodal.applications"  # Of the entry points of applications that are installed.
_INSTALLED = tuple(
    str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "purelib", "platlib")
)


def place_of(error: BaseException) -> str:
    """`FILE:LINE` of the innermost code of a user's own; or empty.

    That is neither this program's nor a package's, but for one that has an application.
    """
    place = ""
    frame: TracebackType | None = error.__traceback__
    while frame is not None:
        code = frame.tb_frame.f_code
        package = str(frame.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        if package != "crossmodal" and Path(code.co_filename).is_file():
            path = Path(code.co_filename).resolve()
            if package in _applications() or not str(path).startswith(_INSTALLED):
                place = f"{path.name}:{frame.tb_lineno}"
        frame = frame.tb_next
    return place


@cache
def _applications() -> frozenset[str]:
    """Packages of installed applications."""
    return frozenset(entry.module.partition(".")[0] for entry in entry_points(group=GROUP))


def told(error: BaseException) -> str:
    """The error in one line, with its place in a user's own code."""
    text = f"{type(error).__name__}: {one_line(error)}"
    place = place_of(error)
    return f"{place}: {text}" if place else text


def traceback_of(error: BaseException) -> str:
    """As Python prints it."""
    return "".join(traceback.format_exception(error)).rstrip()
