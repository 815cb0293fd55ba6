"""`crossmodal run`."""

import select
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crossmodal.diagrams.commands.completion import complete_modalities, complete_scenario
from crossmodal.diagrams.commands.endings import GentleInterrupt, one_line_errors
from crossmodal.diagrams.commands.options import (
    ForceOption,
    QuietOption,
    SetOption,
    StreamOption,
    VerboseOption,
)
from crossmodal.diagrams.commands.run_log import RunLog
from crossmodal.diagrams.commands.run_output import streaming, write_and_report

if TYPE_CHECKING:
    from crossmodal.diagrams.run.application import Application
    from crossmodal.diagrams.run.record import EpisodeRecord
    from crossmodal.diagrams.run.scenario import Scenario

EXAMPLES = (
    "Examples:  crossmodal run drawer --seed 7 --meshcat   |   crossmodal run my.yaml"
    " --set disturbances.lights_off.0.start=5 --out runs/dark   |   crossmodal run drawer"
    " --object models/examples/two_drawers.urdf --grasp-frame left_handle"
)


def run_command(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A scenario's name or a path to a YAML file.", autocompletion=complete_scenario
        ),
    ],
    seed: Annotated[
        int | None, typer.Option(min=0, help="What varies: object, offsets, noise.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the run. [default: runs/SCENARIO-seedSEED, or the next free number]"
        ),
    ] = None,
    force: ForceOption = False,
    meshcat: Annotated[
        bool, typer.Option("--meshcat", help="Watch it live: a page with controls, which stays.")
    ] = False,
    host: Annotated[
        str, typer.Option(help="Interface that Meshcat listens on; '*' for all of them.")
    ] = "localhost",
    port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Of Meshcat's page. [default: a free one from 7000]"),
    ] = None,
    close: Annotated[
        bool, typer.Option("--close", help="With --meshcat: end when the episode does.")
    ] = False,
    paused: Annotated[
        bool,
        typer.Option("--paused", help="With --meshcat: wait on the page before the first tick."),
    ] = False,
    own_object: Annotated[
        Path | None,
        typer.Option(
            "--object",
            metavar="FILE",
            help="Any SDF or URDF, in place of the scenario's object or tool.",
        ),
    ] = None,
    grasp_frame: Annotated[
        str,
        typer.Option(
            help="Its frame or link to grasp (x out of the object, y along the bar), or LINK@POSE."
        ),
    ] = "",
    joint: Annotated[
        str, typer.Option(help="Its joint to explore. [default: the nearest to the grasp]")
    ] = "",
    pull_direction: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="In the grasped frame. [default: 1,0,0]")
    ] = "",
    object_pose: Annotated[
        str,
        typer.Option(
            metavar="X,Y,Z,ROLL,PITCH,YAW",
            help="Of its model frame, [m] and [rad]. [default: handle where the scenario's is]",
        ),
    ] = "",
    scale: Annotated[
        float, typer.Option(help="Of its lengths; 0.001 for a model in millimetres.")
    ] = 1.0,
    recording: Annotated[bool, typer.Option(help="Write meshcat.html.")] = True,
    video: Annotated[
        bool,
        typer.Option("--video", help="Write episode.mp4: camera and view from outside; slower."),
    ] = False,
    record_sensors: Annotated[
        bool, typer.Option("--record-sensors", help="Keep the sensor streams, for `replay`.")
    ] = False,
    stream: StreamOption = "",
    modalities: Annotated[
        str | None,
        typer.Option(
            help="Comma-separated: which of the scenario's estimators run. [default: all]",
            autocompletion=complete_modalities,
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Longest simulated time, [s].")] = None,
    overrides: SetOption = None,
    verbose: VerboseOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate one episode and write what was perceived into a folder."""
    log = RunLog(verbose=verbose, quiet=quiet)
    with one_line_errors(log):
        log.begin("Loading Drake and the scenario")
        from dataclasses import replace

        from crossmodal.diagrams.applications import load_scenario
        from crossmodal.diagrams.drawing.meshcat import clear_player
        from crossmodal.diagrams.run.folder.run_folder import (
            SENSORS_FILE,
            VIDEO_FILE,
            default_folder,
            opened,
        )
        from crossmodal.diagrams.run.video import need_encoder

        assignments = list(overrides or [])
        if seed is not None:
            assignments.append(f"seed={seed}")
        if duration is not None:
            assignments.append(f"duration={duration}")
        if modalities is not None:
            names = [name.strip() for name in modalities.split(",")]
            assignments.append(f"modalities=[{', '.join(names)}]")
        about_object = {
            "grasp_frame": grasp_frame,
            "joint": joint,
            "pull_direction": pull_direction,
            "object_pose": object_pose,
        }
        assignments[:0] = _own_object(scenario, assignments, own_object, scale, about_object)
        application, chosen = load_scenario(scenario, assignments)
        if chosen.replay:
            from crossmodal.diagrams.recordings.replay_recording import repeated_by
            from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

            again = repeated_by(chosen, Path(scenario).parent)
            raise ScenarioError(f"{scenario}: is of a recording; repeat its replay by: {again}")
        if video:
            need_encoder()
        viewer = _start_meshcat(host, port, announce=meshcat) if meshcat or recording else None
        goes_on, named = True, out
        while goes_on:
            numbered = out is None and not force
            with opened(out or default_folder(chosen), force=force, numbered=numbered) as folder:
                sensors_file = folder / SENSORS_FILE if record_sensors else None
                with streaming(stream, log, force=force) as sink:
                    record = _simulate(
                        application,
                        chosen,
                        viewer,
                        log,
                        sensors_file=sensors_file,
                        is_live=meshcat,
                        begins_paused=paused,
                        video_file=folder / VIDEO_FILE if video else None,
                        sink=sink,
                    )
                if not recording:
                    record = replace(record, meshcat_html=None)
                status = write_and_report(folder, application, record, log)
            goes_on = meshcat and (record.wants_next or (not close and _stays(viewer)))
            if goes_on:
                clear_player(viewer)
                assignments.append(f"seed={chosen.seed + 1}")
                _, chosen = load_scenario(scenario, assignments)
                following = f"{named.name}-seed{chosen.seed}" if named else ""
                out = named.with_name(following) if named else None
                if stream.endswith(".mcap"):
                    stream = f"{stream.removesuffix('.mcap')}-seed{chosen.seed}.mcap"
    raise typer.Exit(status)


def _stays(viewer: Any) -> bool:
    """Keeps the page until Enter or Ctrl-C; returns whether it asks for the next seed."""
    from crossmodal.diagrams.run.live.session import stay

    typer.echo(
        f"\nThe page stays at {viewer.web_url()} until Enter or Ctrl-C (--close ends at once)."
    )

    def is_over() -> bool:
        try:
            ready, _, _ = select.select([sys.stdin], [], [], 0.0)
        except (OSError, ValueError):  # Closed, or no file: nobody can type.
            return True
        return bool(ready)  # A line, or the end of what nobody types into.

    return stay(viewer, is_over)


def _own_object(
    scenario: str, assignments: list[str], model: Path | None, scale: float, about: dict[str, str]
) -> list[str]:
    """The assignments that put a user's object in place of the scenario's."""
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.run.own_object import OwnObject, refuse_without_object
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    if model is None:
        refuse_without_object(**about, scale="" if scale == 1.0 else str(scale))
        return []
    application, base = load_scenario(scenario, assignments, units_known=False)
    if application.own_object is None:
        raise ScenarioError(f"--object {model}: '{scenario}' has no object to be replaced")
    own = OwnObject(model=model, pose=about.pop("object_pose"), scale=scale, **about)
    return list(application.own_object(base, scenario, own, assignments))


def _simulate(
    application: "Application",
    scenario: "Scenario",
    viewer: Any,
    log: RunLog,
    **outputs: Any,
) -> "EpisodeRecord":
    """Runs an episode under a progress bar; `outputs` are those of `run_episode`."""
    from tqdm import tqdm

    from crossmodal.diagrams.run.episode import run_episode
    from crossmodal.maths.compiled import COMPILING, compilation_timed

    log.begin(f"Building the simulation of {scenario.name}, seed {scenario.seed}")
    bar = tqdm(
        total=scenario.duration,
        desc=f"{scenario.name}, seed {scenario.seed}",
        bar_format="{desc}: {percentage:3.0f}% |{bar}| {n:.1f}/{total:.1f} s simulated"
        " [{elapsed}<{remaining}]",
        disable=True if log.is_quiet else None,
    )

    def announce() -> None:
        log.note("the filters' inner loops are compiled")
        if not log.is_quiet:
            bar.write(COMPILING)

    with GentleInterrupt() as interrupt, bar, compilation_timed(announce):

        def progress(time: float) -> None:
            interrupt.check()
            bar.update(max(0.0, min(time, scenario.duration) - bar.n))

        record = run_episode(application, scenario, meshcat=viewer, progress=progress, **outputs)
        bar.total = bar.n  # An episode may end before its time is over.
        bar.refresh()
    return record


def _start_meshcat(host: str, port: int | None, *, announce: bool) -> Any:
    from crossmodal.diagrams.drawing.meshcat import start_meshcat
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

    try:
        meshcat = start_meshcat(host, port)
    except RuntimeError as error:
        where = f"--host {host}" if port is None else f"--host {host} --port {port}"
        raise ScenarioError(f"{where}: Meshcat cannot listen there: {one_line(error)}") from None
    if announce:
        typer.echo(f"Watch it at {meshcat.web_url()}")
    return meshcat
