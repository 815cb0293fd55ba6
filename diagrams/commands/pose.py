"""`crossmodal pose`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = (
    "Example:  crossmodal pose --model bottle.obj --scale 0.001 --cloud scene.ply --eye 0,0,0"
    " --touches touches.csv"
)


def pose_command(
    model: Annotated[Path, typer.Option(help="Mesh of the object: OBJ, STL, PLY, ...")],
    cloud: Annotated[
        Path | None, typer.Option(help="Points on it, [m]: PLY, XYZ, or CSV with x, y, z.")
    ] = None,
    touches: Annotated[
        Path | None,
        typer.Option(
            help="Contact points, [m]: CSV with x, y, z and, if known, nx, ny, nz, from where it"
            " was touched."
        ),
    ] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit of the mesh's file.")] = 1.0,
    eye: Annotated[str, typer.Option(metavar="X,Y,Z", help="Where the camera was, [m].")] = "",
    guess: Annotated[
        str,
        typer.Option(
            metavar="X,Y,Z,ROLL,PITCH,YAW",
            help="About where it is, [m], [rad]. [default: anywhere]",
        ),
    ] = "",
    guess_error: Annotated[
        str, typer.Option(metavar="TRANSLATION,ROTATION", help="Of the guess, 1 sigma, [m], [rad].")
    ] = "0.03,0.3",
    table: Annotated[
        float | None, typer.Option(help="Height (z) of what it stands on, [m].")
    ] = None,
    cloud_noise: Annotated[float, typer.Option(help="Of the cloud, 1 sigma, [m].")] = 1.5e-3,
    touch_noise: Annotated[float, typer.Option(help="Of the contacts, 1 sigma, [m].")] = 1e-3,
) -> None:
    """Find where an object is in a cloud and contact points of your own."""
    with one_line_errors():
        from crossmodal.diagrams.commands.pose_files import (
            guessed,
            read_points,
            reported,
            vector_option,
        )
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
        from crossmodal.systems.pose.evidence import Table
        from crossmodal.systems.pose.recorded_pose import estimate_pose
        from crossmodal.systems.pose.target_model import TargetModelError, load_target

        if cloud is None and touches is None:
            raise ScenarioError("pose: name a --cloud, --touches or both")
        values: dict[str, Any] = {"cloud_sigma": cloud_noise, "touch_sigma": touch_noise}
        if cloud is not None:
            values["cloud"], _ = read_points(cloud)
        if touches is not None:
            values["touches"], values["touch_normals"] = read_points(touches)
        if eye:
            values["eye"] = vector_option("--eye", eye, 3)
        if guess:
            values["guess"] = guessed(
                vector_option("--guess", guess, 6), vector_option("--guess-error", guess_error, 2)
            )
        if table is not None:
            values["table"] = Table(height=table)
        try:
            target = load_target(model, scale)
            belief = estimate_pose(target, **values)
        except (TargetModelError, ValueError) as error:
            raise ScenarioError(str(error)) from None
        typer.echo("\n".join(reported(belief, target)))
