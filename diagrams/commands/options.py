"""Options that several commands have."""

from typing import Annotated

import typer

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY.PATH=VALUE", help="Replace one value of the scenario; repeatable."
    ),
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace the files of an earlier run in the folder.")
]
