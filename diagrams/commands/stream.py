"""`crossmodal stream`."""

from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_from
from crossmodal.diagrams.commands.endings import one_line_errors
from crossmodal.diagrams.commands.options import ForceOption, SetOption

EXAMPLES = (
    "Examples:  crossmodal run drawer --record-sensors --out runs/a, then"
    "  crossmodal stream runs/a --to a.mcap   |   crossmodal stream runs/a --to foxglove:8765"
    "   |   live: crossmodal run drawer --stream foxglove"
    "   |   crossmodal replay kitchen.bag --robot wam --calibration my.yaml --stream a.mcap"
)


def stream_command(
    run: Annotated[Path, typer.Argument(help="Folder of a run with --record-sensors.")],
    to: Annotated[
        str,
        typer.Option(
            metavar="FILE.mcap|foxglove[:PORT]",
            help="A file, or a live viewer.",
            autocompletion=complete_from("foxglove"),
        ),
    ],
    force: ForceOption = False,
    overrides: SetOption = None,
) -> None:
    """Show a run's images, frames and estimates in Foxglove, Rerun or RViz."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.applications import load_recorded
        from crossmodal.diagrams.run.replay import replay
        from crossmodal.diagrams.run.sensor_streams.mcap_file import McapFile
        from crossmodal.diagrams.run.stream.sinks import opened_sink
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
        from crossmodal.systems.recordings.open_recording import is_recording

        if not (run / "scenario.yaml").exists() and is_recording(run):
            raise ScenarioError(
                f"{run}: is a recording: `crossmodal replay {run} --robot wam --calibration FILE"
                f" --stream {to}` streams what is perceived in it"
            )
        application, scenario = load_recorded(run, overrides or [])
        with (
            opened_sink(to, force=force) as sink,
            tqdm(desc=f"{scenario.name}, seed {scenario.seed}", unit="tick", disable=None) as bar,
        ):
            typer.echo(f"Streaming to {sink.place}")

            def progress(_: float) -> None:
                bar.update()

            replay(application, run, scenario, progress=progress, sink=sink)
        if isinstance(sink, McapFile):
            typer.echo(f"Open {sink.place} in Foxglove or Rerun")
