"""`crossmodal diagram`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_modalities, complete_scenario
from crossmodal.diagrams.commands.endings import one_line_errors
from crossmodal.diagrams.commands.options import SetOption

EXAMPLES = "Example:  crossmodal diagram drawer --modality vision --out vision.svg"


def diagram_command(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A scenario's name or a path to a YAML file.", autocompletion=complete_scenario
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="The SVG file. [default: runs/SCENARIO-MODALITY.svg]")
    ] = None,
    modality: Annotated[
        str,
        typer.Option(
            help="One of the scenario's estimators. [default: the last one]",
            autocompletion=complete_modalities,
        ),
    ] = "",
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    overrides: SetOption = None,
) -> None:
    """Draw the network of filters with its connections."""
    with one_line_errors():
        from dataclasses import replace

        from crossmodal.diagrams.applications import load_scenario
        from crossmodal.diagrams.drawing.diagram_drawing import diagram_dot, render_svg
        from crossmodal.diagrams.run.build import build_estimators
        from crossmodal.diagrams.run.folder.written_files import write_text
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion

        application, chosen = load_scenario(scenario, overrides or [])
        name = modality or (chosen.modalities[-1] if chosen.modalities else "")
        if name in chosen.modalities:
            chosen = replace(chosen, modalities=[name])
        estimators = build_estimators(application, chosen)
        if not name and estimators:
            name = list(estimators)[-1]
        if name not in estimators:
            raise ScenarioError(f"unknown modality '{name}'; {suggestion(name, estimators)}")
        path = out or Path("runs") / f"{chosen.name}-{name}.svg"
        if os.path.exists(path) and not force:
            raise ScenarioError(f"{path}: exists already; replace it with --force")
        title = f"{chosen.name}: {application.labels.get(name, name)} network"
        try:
            svg = render_svg(diagram_dot(estimators[name], title))
        except RuntimeError as error:
            raise ScenarioError(str(error)) from None
        typer.echo(f"  {write_text(path, svg)}")
