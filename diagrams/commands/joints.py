"""`crossmodal joints`."""

from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.completion import complete_from
from crossmodal.diagrams.commands.endings import FAILED, one_line_errors
from crossmodal.diagrams.commands.options import QuietOption

EXAMPLES = (
    "Examples:  crossmodal joints door.csv --to urdf   |   crossmodal joints first.tum second.tum"
    "   |   crossmodal joints lid.csv --parent box.csv --deviations 1,0.002"
    "   |   crossmodal joints mocap.bag --topic /lid/pose --parent-topic /box/pose"
)


def joints_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Poses of one body: CSV with a header, TUM (t x y z qx qy qz qw), or a ROS 1 bag,"
            " ROS 2 bag or MCAP file. Several files are repeats of the same motion.",
        ),
    ],
    parent: Annotated[
        list[Path] | None,
        typer.Option(
            help="Poses of what it is joined to, in the same frame; repeated, one for each FILE in"
            " their order. [default: it rests]"
        ),
    ] = None,
    topic: Annotated[
        str,
        typer.Option(
            metavar="TOPIC",
            help="Of a bag: stamped poses or transforms, odometry; of TF as TOPIC:CHILD."
            " [default: the only one]",
        ),
    ] = "",
    parent_topic: Annotated[
        str,
        typer.Option(
            metavar="TOPIC",
            help="Of what it is joined to, in the bag of --parent or, without it, in the same.",
        ),
    ] = "",
    deviations: Annotated[
        str,
        typer.Option(
            metavar="DEG,M", help="Of rotation and position, 1 sigma. [default: from the poses]"
        ),
    ] = "",
    columns: Annotated[
        str,
        typer.Option(
            metavar="NAME=COLUMN,...",
            help="Where a CSV names them otherwise: time, x, y, z, qx, qy, qz, qw.",
        ),
    ] = "",
    rate: Annotated[
        float | None, typer.Option(help="Of the poses, [Hz]; times in the file are not used.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit of the positions.")] = 1.0,
    time_scale: Annotated[
        float, typer.Option(help="Seconds per unit of the times; stamps since 1970 need none.")
    ] = 1.0,
    no_wander: Annotated[
        bool,
        typer.Option(
            "--no-wander",
            help="The tracker's rotations have no smooth errors of degrees, as fiducials' have.",
        ),
    ] = False,
    to: Annotated[
        str,
        typer.Option(
            metavar="urdf|sdf",
            help="Write the joint as a model.",
            autocompletion=complete_from("urdf", "sdf"),
        ),
    ] = "",
    out: Annotated[Path | None, typer.Option(help="Folder. [default: runs/joints/FILE]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace its results.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Find how a body is joined to another one, from poses of any tracker."""
    with one_line_errors():
        import numpy as np
        from tqdm import tqdm

        from crossmodal.diagrams.commands.pose_files import vector_option
        from crossmodal.diagrams.joints.track_joint import described, write_results
        from crossmodal.diagrams.run.folder.written_files import write_text
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
        from crossmodal.maths.compiled import COMPILING, compilation_timed
        from crossmodal.systems.compile_ahead import compile_ahead
        from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
        from crossmodal.systems.object_models.model_text import as_name
        from crossmodal.systems.pose_tracks.doubts import doubts
        from crossmodal.systems.pose_tracks.joint_model import to_sdf, to_urdf
        from crossmodal.systems.pose_tracks.pose_track import (
            PoseTrack,
            from_its_start,
            relative_track,
            with_given,
        )
        from crossmodal.systems.pose_tracks.repeats import estimate_repeats
        from crossmodal.systems.pose_tracks.track_files import read_track

        writers = {"": None, "urdf": to_urdf, "sdf": to_sdf}
        if to not in writers:
            raise ScenarioError(f"--to = '{to}', need urdf or sdf")
        parents = parent or (files if parent_topic else [])
        if parents and len(parents) != len(files):
            raise ScenarioError(
                f"--parent: named {len(parents)} times for {len(files)} files of poses; give one"
                " for each file, in the order of the files"
            )
        folder = out or Path("runs/joints") / files[0].stem
        results = [folder / f"joint.{form}" for form in ("yaml", "urdf", "sdf")]
        if any(path.exists() for path in results) and not force:
            raise ScenarioError(f"{folder}: has results; replace them with --force, or name --out")
        named = _named(columns)
        given = None
        if deviations:
            given = vector_option("--deviations", deviations, 2) * [np.deg2rad(1.0), 1.0]
        config = JointFiltersConfig()
        if no_wander:
            config.errors.wander = 0.0
        try:

            def read(file: Path, topic: str) -> PoseTrack:
                track = read_track(
                    file, columns=named, rate=rate, scale=scale, time_scale=time_scale, topic=topic
                )
                return track if given is None else with_given(track, given)

            tracks = [read(file, topic) for file in files]
            for k, path in enumerate(parents):
                of_parent = read(path, parent_topic)
                try:
                    tracks[k] = relative_track(of_parent, tracks[k])
                except ValueError as error:
                    raise ValueError(f"{files[k]} with parent {path}: {error}") from None
            with compilation_timed(lambda: None if quiet else typer.echo(COMPILING, err=True)):
                compile_ahead("joints")
            found = estimate_repeats(
                [from_its_start(track) for track in tracks],
                config,
                progress=lambda poses: tqdm(
                    poses, "poses", leave=False, disable=True if quiet else None
                ),
            )
            notes = doubts(found)
        except ValueError as error:
            raise ScenarioError(str(error)) from None
        if not quiet:
            typer.echo("\n".join(described(found)))
        for note in notes:
            typer.echo(f"note: {note}", err=quiet)
        origin = np.repeat([str(file) for file in files], [len(track.times) for track in tracks])
        paths = write_results(found, notes, folder, files[0].stem, origin.tolist())
        for path in results[1:]:  # Of earlier results.
            path.unlink(missing_ok=True)
        no_model = ""
        if writer := writers[to]:
            try:
                model = writer(found, as_name(files[0].stem))
                paths.append(write_text(folder / f"joint.{to}", model))
            except ValueError as error:
                no_model = f"crossmodal: no joint.{to} is written: {error}"
        if not quiet:
            typer.echo("\nFiles:\n" + "\n".join(f"  {path}" for path in paths))
        if no_model:
            typer.echo(no_model, err=True)
            raise typer.Exit(FAILED)


def _named(columns: str) -> dict[str, str]:
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    pairs = [pair.partition("=") for pair in columns.split(",") if pair]
    if not all(name and equals and column for name, equals, column in pairs):
        raise ScenarioError(f"--columns = '{columns}', need NAME=COLUMN,...")
    return {name.strip(): column.strip() for name, _, column in pairs}
