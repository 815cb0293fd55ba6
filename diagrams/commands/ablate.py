"""`crossmodal ablate`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_connection
from crossmodal.diagrams.commands.endings import one_line_errors

TABLE_FILE = "ablations.md"
EXAMPLES = "Example:  crossmodal ablate body-in-the-hand --seeds 0:5"


def ablate_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Ablations to run, see crossmodal list. [default: all of them]",
            autocompletion=complete_connection,
        ),
    ] = None,
    seeds: Annotated[
        str, typer.Option(help="Like 0:3 (without 3), 5,7 or 20 (from 0 on).")
    ] = "0:3",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/ablations"),
) -> None:
    """Cut the connections between the senses, one at a time, and write what that costs."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.crossmodal.application import APPLICATION
        from crossmodal.diagrams.crossmodal.studies.ablation_study import run_ablations
        from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS, find_ablation
        from crossmodal.diagrams.evaluation.seeds import parse_seeds
        from crossmodal.diagrams.run.folder.run_folder import make_folder
        from crossmodal.diagrams.run.folder.written_files import write_text

        chosen, numbers = names or list(ABLATIONS), parse_seeds(seeds)
        for name in chosen:
            find_ablation(name)
        make_folder(out)
        with tqdm(total=len(chosen) * len(numbers), unit="episode", disable=None) as bar:

            def progress(name: str, seed: int) -> None:
                bar.update()
                bar.write(f"{name}, seed {seed}: done", file=sys.stderr)

            table = run_ablations(APPLICATION, chosen, numbers, out, progress)
        typer.echo(f"{table}\n  {write_text(out / TABLE_FILE, table)}")
