"""How a command ends: its exit status, one line where the user's input is at fault, and Ctrl-C."""

import contextlib
import errno
import logging
import signal
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any, TextIO

import typer

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130


@contextlib.contextmanager
def one_line_errors() -> Iterator[None]:
    """Ends the command with one line and its exit status where the user's input is at fault."""
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

    logging.getLogger("drake").addFilter(_is_error)  # Its level is set anew by each import.
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            yield
    except ScenarioError as error:
        typer.echo(f"crossmodal: {error}", err=True)
        raise typer.Exit(BAD_INPUT) from None
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            where = "" if error.filename is None else f"{error.filename}: "
            typer.echo(f"crossmodal: {where}{one_line(error.strerror or error)}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        typer.echo("crossmodal: no space left for the results: free some or change --out", err=True)
        raise typer.Exit(FAILED) from None
    except KeyboardInterrupt:
        typer.echo("crossmodal: interrupted; nothing unfinished is kept", err=True)
        raise typer.Exit(INTERRUPTED) from None


def _is_error(record: logging.LogRecord) -> bool:
    """Drake's notes and warnings are not for a user."""
    return record.levelno >= logging.ERROR


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning in one line, the program's own without where in the program it arose."""
    if category.__module__.startswith("crossmodal.diagrams."):
        typer.echo(f"crossmodal: warning: {message}", err=True)
    else:
        text = warnings.formatwarning(message, category, filename, lineno, line)
        typer.echo(text, file=file, err=True, nl=False)


class GentleInterrupt:
    """Lets a Ctrl-C wait until the simulation is between two steps; a second one acts at once."""

    def __init__(self) -> None:
        self._requested = False
        self._previous: Any = None

    def __enter__(self) -> "GentleInterrupt":
        self._previous = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._previous)

    def _note(self, _signal: int, _frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True

    def check(self) -> None:
        """Raises KeyboardInterrupt if one was asked for."""
        if self._requested:
            raise KeyboardInterrupt
