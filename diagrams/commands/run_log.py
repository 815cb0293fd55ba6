"""What happens in a run, for `log.txt` in its folder and for who asks for it with -v."""

import datetime
import logging
import sys
import time
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from crossmodal.diagrams.run.record import EpisodeRecord


class RunLog:
    """Collects lines with their time since the command began.

    Attributes:
        is_quiet: Whether only what went wrong is printed.
        is_verbose: Whether each line is printed when it is noted.

    Args:
        verbose: Print each line when it is noted.
        quiet: Print only what went wrong.
        command: What is run; by default this program with its arguments.
    """

    def __init__(self, *, verbose: bool = False, quiet: bool = False, command: str = "") -> None:
        self.is_quiet, self.is_verbose = quiet, verbose and not quiet
        self._start = time.monotonic()
        now = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        self._lines = [f"{now}: {command or ' '.join(['crossmodal', *sys.argv[1:]])}"]
        if self.is_verbose:
            typer.echo(self._lines[0], err=True)

    def note(self, text: str) -> None:
        """Keeps a line."""
        line = f"{time.monotonic() - self._start:8.2f} s  {text}"
        self._lines.append(line)
        if self.is_verbose:
            typer.echo(line, err=True)

    def begin(self, text: str) -> None:
        """Keeps a line that tells a person at the terminal what they wait for."""
        self.note(text)
        if not self.is_quiet and not self.is_verbose and sys.stderr.isatty():
            typer.echo(f"{text} ...", err=True)

    def say(self, text: str) -> None:
        """Prints what is no error."""
        if not self.is_quiet:
            typer.echo(text)

    def filter(self, record: logging.LogRecord) -> bool:
        """Keeps what Drake says; only its errors are for a person who has not asked for more."""
        self.note(f"Drake, {record.levelname.lower()}: {' '.join(record.getMessage().split())}")
        return record.levelno >= logging.ERROR

    def text(self, record: "EpisodeRecord") -> str:
        """All lines and, after them, what happened in the episode, in simulated time."""
        return "\n".join([*self._lines, *self.ending(record), ""])

    def ending(self, record: "EpisodeRecord") -> list[str]:
        """Lines with the versions and what happened in the episode, in simulated time."""
        from crossmodal.diagrams.run.folder.fingerprint import versions

        computed = ", ".join(f"{name} {version}" for name, version in versions().items())
        events = [f"{event.time:8.2f} s  {event.name}" for event in record.events]
        ended = "interrupted" if record.interrupted else "ended"
        return [
            f"Versions: {computed}.",
            "Events, in simulated time:",
            *events,
            f"{record.duration:8.2f} s  {ended}; {record.wall_time:.1f} s of computing",
        ]
