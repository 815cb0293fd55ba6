"""What a run leaves behind: its files, a report and an exit status."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from crossmodal.diagrams.commands.endings import FAILED, INTERRUPTED
from crossmodal.diagrams.commands.run_log import RunLog

if TYPE_CHECKING:
    from crossmodal.diagrams.run.application import Application, Results
    from crossmodal.diagrams.run.record import EpisodeRecord
    from crossmodal.diagrams.run.stream.sinks import Sink


@contextlib.contextmanager
def streaming(target: str, log: RunLog, *, force: bool) -> Iterator["Sink | None"]:
    """Where estimates are streamed to, if anywhere."""
    if not target:
        yield None
        return
    from crossmodal.diagrams.run.stream.sinks import opened_sink

    with opened_sink(target, force=force) as sink:
        log.say(f"Streaming to {sink.place}")
        yield sink


def write_and_report(
    folder: Path, application: "Application", record: "EpisodeRecord", log: RunLog
) -> int:
    """Writes the run, prints its report and returns the exit status.

    What was perceived is said before the large files are written, which may not fit on the disk.
    """
    from crossmodal.diagrams.evaluation.run_writer import RunWriter, evaluated

    results = evaluated(application, record)
    if record.traceback:
        log.note(record.traceback)
    writer = RunWriter(folder, application, record, results, log=log.text(record))
    writer.write_results()
    summary = writer.summary
    log.say("\n".join(["", *results.report(summary), "", speed(summary)]))
    if not record.interrupted and not results.success:
        typer.echo(f"\n{verdict(results, record)}", err=log.is_quiet)
    writer.write_pictures()
    log.say("\n".join(["", "Files:", *(f"  {path}" for path in writer.written)]))
    for line in writer.missing:
        typer.echo(f"crossmodal: {line}", err=True)
    if record.interrupted:
        typer.echo(
            f"crossmodal: interrupted at {record.duration:.1f} s; the files above hold what was"
            " perceived until then",
            err=True,
        )
        return INTERRUPTED
    return FAILED if writer.missing or results.success is False else 0


def verdict(results: "Results", record: "EpisodeRecord") -> str:
    """What became of the task, where it is no success."""
    if results.success is None:
        return (
            "Whether the task was done is not known: the recording does not hold the truth or what"
            " the robot did."
        )
    longest = record.scenario.duration
    is_over = record.duration > longest - 0.5 * record.scenario.network_period
    if is_over and not record.traceback:
        return f"The {longest:g} s that the episode may take were over: {results.failure}"
    return f"The episode failed: {results.failure}"


def speed(summary: dict[str, Any]) -> str:
    """How fast it ran and what memory it took."""
    factor = summary["real_time_factor"]
    text = f"{summary['duration']:.1f} s simulated in {summary['wall_time']:.1f} s"
    if factor is not None:
        text += f" (real-time factor {factor:.2f})"
    if summary["peak_memory"]:
        text += f", peak memory {summary['peak_memory'] / 1e9:.2f} GB"
    return text
