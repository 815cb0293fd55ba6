"""`crossmodal list`."""

import typer

from diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal list, then  crossmodal run cupboard-door"


def list_command() -> None:
    """Show the scenarios, experiments, flows and networks that there are."""
    with one_line_errors():
        from diagrams.crossmodal.ablations import ABLATIONS
        from diagrams.crossmodal.experiments import ALL, find_experiments
        from diagrams.crossmodal.scenario import load_scenario, scenario_files

        typer.echo("Scenarios (crossmodal run NAME):")
        for name, path in scenario_files().items():
            typer.echo(f"  {name:19}{load_scenario(str(path)).description}")
        typer.echo("Experiments (crossmodal evaluate NAME):")
        for name, experiment in find_experiments(ALL).items():
            typer.echo(f"  {name:19}{experiment.description}")
        typer.echo("Flows of information (crossmodal ablate NAME):")
        for name, ablation in ABLATIONS.items():
            typer.echo(f"  {name:19}{ablation.flow}")
        typer.echo("Networks (crossmodal train NAME):")
        typer.echo("  hand-bending       the soft hand's bending from wrench and air pressure")
