"""`crossmodal compare`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal compare runs/a runs/b --out difference.html"


def compare_command(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="RUN RUN...", help="Folders of runs or of evaluations."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Page with pictures, an HTML file. [default: none]")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Print all rows, not only the first eight.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the page.")] = False,
) -> None:
    """Show runs or evaluations side by side: figures, their differences, scenarios, pictures."""
    with one_line_errors():
        from crossmodal.diagrams.applications import find_application
        from crossmodal.diagrams.evaluation.campaign_report import made_by
        from crossmodal.diagrams.evaluation.comparison import (
            MAIN_ROWS,
            comparison,
            comparison_page,
            read_compared,
        )
        from crossmodal.diagrams.run.folder.written_files import write_text
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        if len(folders) < 2:
            raise ScenarioError(f"compare {folders[0]}: with what? Name two folders or more")
        if out is not None and os.path.exists(out) and not force:
            raise ScenarioError(f"{out}: exists already; replace it with --force")
        names = [folder.resolve().name for folder in folders]
        if len(set(names)) < len(names):
            names = [str(folder) for folder in folders]
        compared = [
            read_compared(folder, name, find_application)
            for folder, name in zip(folders, names, strict=True)
        ]
        typer.echo(comparison(compared, most=None if every else MAIN_ROWS))
        if out is not None:
            origin = made_by(f"crossmodal compare {' '.join(map(str, folders))}")
            typer.echo(f"  {write_text(out, comparison_page(compared, origin))}")
