"""What a run leaves behind: its folder, a report and an exit status."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from diagrams.commands.endings import FAILED, INTERRUPTED

if TYPE_CHECKING:
    from diagrams.run.record import EpisodeResult


@contextlib.contextmanager
def run_folder(folder: Path, force: bool) -> Iterator[Path]:
    """The opened folder of a run; one that nothing was written into is removed again."""
    from diagrams.run.run_folder import open_run_folder

    open_run_folder(folder, force)
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()


def write_and_report(folder: Path, result: "EpisodeResult") -> int:
    """Writes the run, prints its report and returns the exit status."""
    from diagrams.crossmodal.results.report import report
    from diagrams.run.run_folder import SUMMARY_FILE, write_run

    written = write_run(folder, result)
    summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    typer.echo(report(result, summary, written))
    if result.interrupted:
        typer.echo(
            f"crossmodal: interrupted at {result.duration:.1f} s; the files above hold what was"
            " perceived until then",
            err=True,
        )
        return INTERRUPTED
    return 0 if result.failure is None else FAILED
