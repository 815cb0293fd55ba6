"""`crossmodal show`."""

import shutil
import textwrap
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = (
    "Examples:  crossmodal show drawer control.exploration   |   crossmodal show drawer"
    " objects.drawer.friction"
)


def show_command(
    scenario: Annotated[
        str, typer.Argument(help="See 'crossmodal list', or a YAML file.", metavar="SCENARIO")
    ],
    key: Annotated[
        str, typer.Argument(help="A value or a part of it. [default: all]", metavar="[KEY]")
    ] = "",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY.PATH=VALUE", help="Replace a value; repeatable."),
    ] = None,
) -> None:
    """Show a scenario's values: what they are, may be and mean."""
    with one_line_errors():
        from crossmodal.diagrams.applications import load_scenario
        from crossmodal.diagrams.run.yaml_input.values_table import values_table

        _, loaded = load_scenario(scenario, set_ or [])
        width = max(60, min(shutil.get_terminal_size((100, 24)).columns, 120))
        for line in values_table(loaded, key):
            possible = f"   ({line.possible})" if line.possible else ""
            typer.echo(f"{line.key} = {line.value}{possible}")
            if line.meaning:
                indent = "    "
                typer.echo(textwrap.fill(line.meaning, width, initial_indent=indent,
                                         subsequent_indent=indent))  # fmt: skip
