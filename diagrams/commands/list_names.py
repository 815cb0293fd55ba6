"""`crossmodal list`."""

from pathlib import Path

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal list, then  crossmodal run cupboard-door"


def list_command() -> None:
    """Show the scenarios, experiments, ablations and networks that there are."""
    with one_line_errors():
        from crossmodal.diagrams.commands.listings import COME_ALONG, listings
        from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS
        from crossmodal.diagrams.run.listing import description_of

        known = listings()
        files = {name: path for one in known for name, path in one.files().items()}
        width = max(map(len, files), default=0) + 1
        for application in known:
            if len(known) > 1:
                typer.echo(f"{application.name}: {application.description}")
            typer.echo("Scenarios (crossmodal run NAME):")
            for name, path in application.files().items():
                is_ours = application.name in COME_ALONG
                _line(name, description_of(path, files) if is_ours else _checked(path), width)
            if application.experiments:
                typer.echo("Experiments (crossmodal evaluate NAME):")
            for name, experiment in application.experiments.items():
                _line(name, experiment.description, width)
        typer.echo("Ablations (crossmodal ablate NAME):")
        for name, ablation in ABLATIONS.items():
            _line(name, ablation.flow, width)
        typer.echo("Networks (crossmodal train NAME):")
        _line("hand-bending", "the soft hand's bending from wrench and air pressure", width)
        _line("segmentation", "which object each pixel of an image of the table shows", width)
        _line("grasp", "where and how well objects can be grasped from above", width)


def _checked(path: Path) -> str:
    """What a scenario says that it is; of one that cannot be used, why."""
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    try:
        return str(load_scenario(str(path))[1].description)
    except ScenarioError as error:
        return f"cannot be used: {error}"


def _line(name: str, text: str, width: int) -> None:
    typer.echo(f"  {name:{width}} {text}")
