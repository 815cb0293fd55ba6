"""`crossmodal show`."""

import contextlib
import shutil
import sys
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_key, complete_scenario
from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = (
    "Examples:  crossmodal show drawer control.exploration   |   crossmodal show drawer"
    " objects.drawer.friction   |   crossmodal show runs/drawer-seed7"
)


def show_command(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A scenario, see 'crossmodal list', or a YAML file; or a run's folder.",
            metavar="SCENARIO|RUN",
            autocompletion=complete_scenario,
        ),
    ],
    key: Annotated[
        str,
        typer.Argument(help="Of a scenario, a value or a part of it. [default: all]",
                       metavar="[KEY]", autocompletion=complete_key),
    ] = "",
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY.PATH=VALUE",
            help="Of a scenario, replace a value; repeatable.",
            autocompletion=complete_key,
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Of a run's page. [default: a free one]"),
    ] = None,
) -> None:  # fmt: skip
    """Show a scenario's values and what they mean, or a finished run in the browser."""
    with one_line_errors():
        from crossmodal.diagrams.applications import scenario_files
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        if Path(scenario).is_dir() and scenario not in scenario_files():
            if key or set_:
                raise ScenarioError(f"{scenario}: is a folder; KEY and --set are for scenarios")
            _show_run(Path(scenario), port or 0)
        elif port is not None:
            raise ScenarioError(f"--port {port}: '{scenario}' is no folder of a run")
        else:
            _show_values(scenario, key, set_ or [])


def _show_values(scenario: str, key: str, assignments: list[str]) -> None:
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.run.yaml_input.values_table import values_table

    _, loaded = load_scenario(scenario, assignments)
    width = max(60, min(shutil.get_terminal_size((100, 24)).columns, 120))
    for line in values_table(loaded, key):
        possible = f"   ({line.possible})" if line.possible else ""
        typer.echo(f"{line.key} = {line.value}{possible}")
        if line.meaning:
            indent = "    "
            typer.echo(textwrap.fill(line.meaning, width, initial_indent=indent,
                                     subsequent_indent=indent))  # fmt: skip


def _show_run(folder: Path, port: int) -> None:
    """Serves the page of a run until Enter or Ctrl-C; where nobody can type, until a signal."""
    import threading

    from crossmodal.diagrams.applications import find_application
    from crossmodal.diagrams.evaluation.finished_run.read_run import read_finished_run
    from crossmodal.diagrams.evaluation.finished_run.server import RunServer

    run = read_finished_run(folder, find_application)
    for line in run.missing:
        typer.echo(f"crossmodal: {line}", err=True)
    with RunServer(run, port) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        can_type = sys.stdin is not None and sys.stdin.isatty()
        end = "Enter or Ctrl-C" if can_type else "Ctrl-C"
        typer.echo(f"{folder} is shown at {server.url} until {end}.")
        with contextlib.suppress(KeyboardInterrupt):
            sys.stdin.readline() if can_type else thread.join()
        server.shutdown()
