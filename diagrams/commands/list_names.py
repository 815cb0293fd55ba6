"""`crossmodal list`."""

import typer

from diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal list, then  crossmodal run cupboard-door"


def list_command() -> None:
    """Show the scenarios, experiments, flows and networks that there are."""
    with one_line_errors():
        from diagrams.applications import applications, load_scenario

        known = applications()
        for application in known.values():
            if len(known) > 1:
                typer.echo(f"{application.name}: {application.description}")
            typer.echo("Scenarios (crossmodal run NAME):")
            for path in sorted(application.scenarios.glob("*.yaml"), key=lambda path: path.stem):
                _line(path.stem, load_scenario(str(path))[1].description)
            if application.experiments:
                typer.echo("Experiments (crossmodal evaluate NAME):")
            for name, experiment in application.experiments.items():
                _line(name, experiment.description)
            for heading, lines in application.extras.items():
                typer.echo(f"{heading}:")
                for name, text in lines.items():
                    _line(name, text)


def _line(name: str, text: str) -> None:
    typer.echo(f"  {name:18} {text}")
