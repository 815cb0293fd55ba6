"""`crossmodal inspect`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_scenario
from crossmodal.diagrams.commands.endings import one_line_errors

_SCENARIO = "drawer"
EXAMPLES = (
    "Examples:  crossmodal inspect models/examples/two_drawers.urdf   |"
    "   crossmodal inspect kitchen.bag --drafts ."
)


def inspect_command(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL|RECORDING",
            help="An SDF or URDF file; or a ROS 1 bag, a ROS 2 bag, an MCAP file, or a folder"
            " of the RBO data set.",
        ),
    ],
    grasp_frame: Annotated[
        str, typer.Option(help="Its frame or link to grasp. [default: its first likely handle]")
    ] = "",
    joint: Annotated[
        str, typer.Option(help="Its joint to explore. [default: the nearest to the grasp]")
    ] = "",
    pull_direction: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="In the grasped frame. [default: as it opens]")
    ] = "",
    object_pose: Annotated[
        str, typer.Option(metavar="X,Y,Z,ROLL,PITCH,YAW", help="Of its model frame, [m], [rad].")
    ] = "",
    scale: Annotated[
        float, typer.Option(help="Of its lengths; 0.001 for a model in millimetres.")
    ] = 1.0,
    scenario: Annotated[
        str,
        typer.Option(
            help="In which it would stand: one whose object is grasped and opened.",
            autocompletion=complete_scenario,
        ),
    ] = _SCENARIO,
    out: Annotated[Path | None, typer.Option(help="The picture. [default: runs/MODEL.png]")] = None,
    drafts: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Of a recording: write drafts of topics.yaml and calibration.yaml there.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace picture or drafts.")] = False,
) -> None:
    """Show what is in a model or a recording, and how to run or replay it."""
    with one_line_errors():
        from crossmodal.systems.recordings.open_recording import is_recording

        given = {
            "--grasp-frame": grasp_frame,
            "--joint": joint,
            "--pull-direction": pull_direction,
            "--object-pose": object_pose,
            "--scale": "" if scale == 1.0 else scale,
            "--scenario": "" if scenario == _SCENARIO else scenario,
            "--out": out,
        }
        if is_recording(model):
            _refuse(given, f"{model} is a recording; this is for models")
            _inspect_recording(model, drafts, force=force)
            return
        if model.exists():
            _refuse({"--drafts": drafts}, f"{model} is no recording, of which drafts are written")
        from crossmodal.diagrams.applications import load_scenario
        from crossmodal.diagrams.crossmodal.inspection.inspection import inspected
        from crossmodal.diagrams.run.folder.written_files import write_atomically
        from crossmodal.diagrams.run.own_object import OwnObject
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        path = out or Path("runs") / f"{model.stem}.png"
        if path.exists() and not force:
            raise ScenarioError(f"{path}: exists already; replace it with --force, or name --out")
        own = OwnObject(
            model=model,
            grasp_frame=grasp_frame,
            joint=joint,
            pull_direction=pull_direction,
            pose=object_pose,
            scale=scale,
        )
        lines, figure = inspected(own, scenario, lambda given: load_scenario(scenario, given)[1])
        if figure is not None:
            from crossmodal.diagrams.drawing.plot_style import save

            drawn = figure
            lines += ["Picture", f"  {write_atomically(path, lambda file: save(drawn, file))}"]
        typer.echo("\n".join(lines))


def _refuse(given: Mapping[str, object], why: str) -> None:
    """Refuses the first option that would do nothing."""
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    for option, value in given.items():
        if value not in ("", None):
            raise ScenarioError(f"{option} {value}: {why}")


def _inspect_recording(path: Path, folder: Path | None, *, force: bool) -> None:
    from tqdm import tqdm

    from crossmodal.diagrams.recordings.report import can_be_replayed, described, drafts, written
    from crossmodal.diagrams.recordings.survey import survey
    from crossmodal.diagrams.recordings.topic_map import likely_topic_map
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
    from crossmodal.systems.recordings.recording import RecordingError

    try:
        with tqdm(desc="reading", unit="messages", disable=None, leave=False) as bar:
            found = survey(path, lambda _: bar.update())
        typer.echo("\n".join(described(found)))
        if folder is not None:
            paths = written(found, folder, force=force)
            typer.echo("\nFiles:\n" + "\n".join(f"  {file}" for file in paths))
            return
        if not can_be_replayed(likely_topic_map(found)):
            return
        for name, text in drafts(found).items():
            typer.echo(f"\nDraft of {name}\n\n{text}", nl=False)
    except RecordingError as error:
        raise ScenarioError(str(error)) from None
