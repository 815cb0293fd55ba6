"""`crossmodal list`."""

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal list, then  crossmodal run cupboard-door"


def list_command() -> None:
    """Show the scenarios, experiments, flows and networks that there are."""
    with one_line_errors():
        from crossmodal.diagrams.applications import applications, load_scenario, scenarios_of

        known = applications()
        names = [name for application in known.values() for name in scenarios_of(application)]
        width = max(map(len, names), default=0) + 1
        for application in known.values():
            if len(known) > 1:
                typer.echo(f"{application.name}: {application.description}")
            typer.echo("Scenarios (crossmodal run NAME):")
            for name, path in scenarios_of(application).items():
                _line(name, load_scenario(str(path))[1].description, width)
            if application.experiments:
                typer.echo("Experiments (crossmodal evaluate NAME):")
            for name, experiment in application.experiments.items():
                _line(name, experiment.description, width)
            for heading, lines in application.extras.items():
                typer.echo(f"{heading}:")
                for name, text in lines.items():
                    _line(name, text, width)


def _line(name: str, text: str, width: int) -> None:
    typer.echo(f"  {name:{width}} {text}")
