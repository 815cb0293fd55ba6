"""`crossmodal diagram`."""

from pathlib import Path
from typing import Annotated

import typer

from diagrams.commands.endings import one_line_errors
from diagrams.commands.options import SetOption

EXAMPLES = "Example:  crossmodal diagram drawer --modality vision --out vision.svg"


def diagram_command(
    scenario: Annotated[str, typer.Argument(help="A scenario's name or a path to a YAML file.")],
    out: Annotated[
        Path | None, typer.Option(help="The SVG file. [default: SCENARIO-MODALITY.svg]")
    ] = None,
    modality: Annotated[
        str, typer.Option(help="vision, proprioception or crossmodal.")
    ] = "crossmodal",
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    overrides: SetOption = None,
) -> None:
    """Draw the network of filters with its wires."""
    with one_line_errors():
        from diagrams.crossmodal.scenario import MODALITIES, load_scenario
        from diagrams.drawing.diagram_drawing import network_dot, render_svg
        from diagrams.drawing.palette import MODALITY_LABEL
        from diagrams.run.episode import build_networks, build_station
        from diagrams.run.run_folder import write_text
        from diagrams.run.yaml_schema import ScenarioError, suggestion

        if modality not in MODALITIES:
            raise ScenarioError(
                f"unknown modality '{modality}'; {suggestion(modality, MODALITIES)}"
            )
        chosen = load_scenario(scenario, overrides or [])
        path = out or Path(f"{chosen.name}-{modality}.svg")
        if path.exists() and not force:
            raise ScenarioError(f"{path}: exists already; replace it with --force")
        title = f"{chosen.name}: {MODALITY_LABEL[modality]} network"
        chosen.modalities = [modality]
        network = build_networks(chosen, build_station(chosen, chosen.seed))[modality]
        svg = render_svg(network_dot(network, title))
        typer.echo(f"  {write_text(path, svg)}")
