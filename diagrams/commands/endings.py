"""How a command ends: its exit status, one line where the user's input is at fault, and Ctrl-C."""

import contextlib
import errno
import logging
import signal
import warnings
from collections.abc import Iterator
from functools import partial
from types import FrameType
from typing import Any, TextIO

import typer

from crossmodal.diagrams.commands.run_log import RunLog

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130


@contextlib.contextmanager
def one_line_errors(log: RunLog | None = None) -> Iterator[None]:
    """Ends the command with one line and its exit status where the user's input is at fault.

    Args:
        log: Keeps warnings and what Drake says.
    """
    from crossmodal.diagrams.run.own_code import place_of, told, traceback_of
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

    try:
        with noted(log):
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
    except Exception as error:
        if not place_of(error):
            raise
        if log is not None:
            log.note(traceback_of(error))
        typer.echo(f"crossmodal: {told(error)}", err=True)
        raise typer.Exit(FAILED) from None
    except KeyboardInterrupt:
        typer.echo("crossmodal: interrupted; nothing unfinished is kept", err=True)
        raise typer.Exit(INTERRUPTED) from None


@contextlib.contextmanager
def noted(log: RunLog | None) -> Iterator[None]:
    """Shows warnings in one line and Drake's errors; both are kept in the log."""
    drake = logging.getLogger("drake")  # Its level is set anew by each import.
    chosen = _is_error if log is None else log.filter
    drake.addFilter(chosen)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning if log is None else partial(_keep_warning, log)
            yield
    finally:
        drake.removeFilter(chosen)


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


def _keep_warning(
    log: RunLog, message: Warning | str, category: type[Warning], *about: Any, **rest: Any
) -> None:
    log.note(f"warning: {message}")
    if not log.is_verbose:
        _show_warning(message, category, *about, **rest)


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
