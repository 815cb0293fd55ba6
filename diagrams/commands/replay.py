"""`crossmodal replay`."""

from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import FAILED, INTERRUPTED, one_line_errors
from crossmodal.diagrams.commands.options import ForceOption, SetOption
from crossmodal.diagrams.commands.run_output import write_and_report

EXAMPLES = (
    "Example:  crossmodal run drawer --record-sensors --out runs/a, then"
    "  crossmodal replay runs/a --set 'perception.cut=[held_body_to_grasp]'"
)


def replay_command(
    run: Annotated[Path, typer.Argument(help="Folder of a run with --record-sensors.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder. [default: RUN/replay, or the next free number]")
    ] = None,
    force: ForceOption = False,
    overrides: SetOption = None,
) -> None:
    """Perceive a recorded run again, with other filters or connections, without simulating."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.applications import load_recorded
        from crossmodal.diagrams.run.folder.run_folder import opened
        from crossmodal.diagrams.run.replay import replay
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        application, chosen = load_recorded(run, overrides or [])
        if out is not None and out.resolve() == run.resolve():
            raise ScenarioError(f"--out {out}: holds the recorded run itself; choose another")
        numbered = out is None and not force
        with opened(out or run / "replay", force=force, numbered=numbered) as folder:
            title = f"{chosen.name}, seed {chosen.seed}"
            with tqdm(desc=title, unit="tick", disable=None) as bar:

                def progress(_: float) -> None:
                    bar.update()

                record = replay(application, run, chosen, progress=progress)
            status = write_and_report(folder, application, record)
            if status == INTERRUPTED:  # Not this command, but the run that it replays.
                status = FAILED
    raise typer.Exit(status)
