"""Options that several commands have."""

from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_key

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Replace one value of the scenario; repeatable.",
        autocompletion=complete_key,
    ),
]
StreamOption = Annotated[
    str,
    typer.Option(
        metavar="FILE.mcap|foxglove[:PORT]",
        help="Images, frames and estimates for a viewer, live or as a file.",
    ),
]
VerboseOption = Annotated[
    bool, typer.Option("-v", "--verbose", help="Print what happens while it happens.")
]
QuietOption = Annotated[bool, typer.Option("-q", "--quiet", help="Print only what goes wrong.")]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace the files of an earlier run in the folder.")
]
