"""What a run leaves behind: its folder, a report and an exit status."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from diagrams.commands.endings import FAILED, INTERRUPTED

if TYPE_CHECKING:
    from diagrams.run.application import Application
    from diagrams.run.record import EpisodeRecord


@contextlib.contextmanager
def run_folder(folder: Path, force: bool) -> Iterator[Path]:
    """The opened folder of a run; one that nothing was written into is removed again."""
    from diagrams.run.run_folder import open_run_folder

    made = [path for path in (folder, *folder.parents) if not path.exists()]
    open_run_folder(folder, force)
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):
            for path in made:
                path.rmdir()


def write_and_report(folder: Path, application: "Application", record: "EpisodeRecord") -> int:
    """Writes the run, prints its report and returns the exit status."""
    from diagrams.run.run_folder import SUMMARY_FILE, write_run

    results = application.evaluate(record)
    written = write_run(folder, application, record, results)
    summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    lines = ["", *results.report(summary), "", speed(summary), "", "Files:"]
    lines += [f"  {path}" for path in written]
    if results.failure is not None and not record.interrupted:
        lines += ["", f"The episode failed: {results.failure}"]
    typer.echo("\n".join(lines))
    if record.interrupted:
        typer.echo(
            f"crossmodal: interrupted at {record.duration:.1f} s; the files above hold what was"
            " perceived until then",
            err=True,
        )
        return INTERRUPTED
    return 0 if results.failure is None else FAILED


def speed(summary: dict[str, Any]) -> str:
    """How fast it ran and what memory it took."""
    factor = summary["real_time_factor"]
    text = f"{summary['duration']:.1f} s simulated in {summary['wall_time']:.1f} s"
    if factor is not None:
        text += f" (real-time factor {factor:.2f})"
    if summary["peak_memory"]:
        text += f", peak memory {summary['peak_memory'] / 1e9:.2f} GB"
    return text
