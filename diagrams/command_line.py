"""The `crossmodal` command. What a command needs is imported when it runs, so help is instant."""

import contextlib
import logging
import signal
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

if TYPE_CHECKING:
    from diagrams.episode_record import EpisodeResult
    from diagrams.experiment_runner import Evaluation, Workers
    from diagrams.scenario import Scenario

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130

app = typer.Typer(
    help="Interactive perception in Drake: a robot moves something and reads what vision,"
    " proprioception and touch say together.",
    epilog="Start with:  crossmodal run drawer",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
train_app = typer.Typer(
    help="Make the training data in simulation and train a small network on them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(train_app, name="train")

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY.PATH=VALUE", help="Replace one value of the scenario; repeatable."
    ),
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace the files of an earlier run in the folder.")
]


class GentleInterrupt:
    """Lets a Ctrl-C wait until the simulation is between two steps; a second one acts at once."""

    def __init__(self) -> None:
        self._requested = False
        self._previous: Any = None

    def __enter__(self) -> "GentleInterrupt":
        self._previous = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._previous)

    def _note(self, _signal: int, _frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True

    def check(self) -> None:
        """Raises KeyboardInterrupt if one was asked for."""
        if self._requested:
            raise KeyboardInterrupt


@contextlib.contextmanager
def one_line_errors() -> Iterator[None]:
    """Ends the command with one line and its exit status where the user's input is at fault."""
    from diagrams.yaml_schema import ScenarioError

    logging.getLogger("drake").setLevel(logging.ERROR)  # Its notes are not for a user.
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            yield
    except ScenarioError as error:
        typer.echo(f"crossmodal: {error}", err=True)
        raise typer.Exit(BAD_INPUT) from None
    except KeyboardInterrupt:
        typer.echo("crossmodal: interrupted before there was anything to keep", err=True)
        raise typer.Exit(INTERRUPTED) from None


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning in one line, the program's own without where in the program it arose."""
    if category.__module__.startswith("diagrams."):
        typer.echo(f"crossmodal: warning: {message}", err=True)
    else:
        text = warnings.formatwarning(message, category, filename, lineno, line)
        typer.echo(text, file=file, err=True, nl=False)


@app.command("list")
def list_command() -> None:
    """Show the scenarios, experiments and networks that there are."""
    with one_line_errors():
        from diagrams.experiments import ALL, find_experiments
        from diagrams.scenario import load_scenario, scenario_files

        typer.echo("Scenarios (crossmodal run NAME):")
        for name, path in scenario_files().items():
            typer.echo(f"  {name:19}{load_scenario(str(path)).description}")
        typer.echo("Experiments (crossmodal evaluate NAME):")
        for name, experiment in find_experiments(ALL).items():
            typer.echo(f"  {name:19}{experiment.description}")
        typer.echo("Networks (crossmodal train NAME):")
        typer.echo("  hand-bending       the soft hand's bending from wrench and air pressure")


@app.command(
    "run",
    epilog="Examples:  crossmodal run drawer --seed 7 --meshcat   |   crossmodal run my.yaml"
    " --set disturbances.lights_off.0.start=5 --out runs/dark   |   crossmodal run drawer"
    " --object models/examples/two_drawers.urdf --grasp-frame left_handle",
)
def run_command(
    scenario: Annotated[str, typer.Argument(help="A scenario's name or a path to a YAML file.")],
    seed: Annotated[
        int | None, typer.Option(min=0, help="What varies: object, offsets, noise.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the run. [default: runs/SCENARIO-seedSEED]")
    ] = None,
    force: ForceOption = False,
    meshcat: Annotated[
        bool, typer.Option("--meshcat", help="Print an address where it can be watched live.")
    ] = False,
    host: Annotated[
        str, typer.Option(help="Interface that Meshcat listens on; '*' for all of them.")
    ] = "localhost",
    own_object: Annotated[
        Path | None,
        typer.Option(
            "--object", metavar="FILE", help="Any SDF or URDF, in place of the scenario's object."
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
    recording: Annotated[bool, typer.Option(help="Write meshcat.html.")] = True,
    record_sensors: Annotated[
        bool, typer.Option("--record-sensors", help="Keep the sensor streams, for `replay`.")
    ] = False,
    modalities: Annotated[
        str | None, typer.Option(help="Comma-separated, of vision,proprioception,crossmodal.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Longest simulated time, [s].")] = None,
    overrides: SetOption = None,
) -> None:
    """Simulate one episode and write what was perceived into a folder."""
    with one_line_errors():
        from diagrams.own_object import OwnObject, own_object_assignments, refuse_without_object
        from diagrams.run_folder import SENSORS_FILE, default_folder, open_run_folder
        from diagrams.scenario import load_scenario

        assignments = list(overrides or [])
        if seed is not None:
            assignments.append(f"seed={seed}")
        if duration is not None:
            assignments.append(f"duration={duration}")
        if modalities is not None:
            names = [name.strip() for name in modalities.split(",")]
            assignments.append(f"modalities=[{', '.join(names)}]")
        if own_object is None:
            refuse_without_object(
                grasp_frame=grasp_frame,
                joint=joint,
                pull_direction=pull_direction,
                object_pose=object_pose,
            )
        else:
            own = OwnObject(
                model=own_object,
                grasp_frame=grasp_frame,
                joint=joint,
                pull_direction=pull_direction,
                pose=object_pose,
            )
            assignments = own_object_assignments(scenario, assignments, own) + assignments
        chosen = load_scenario(scenario, assignments)
        folder = open_run_folder(out or default_folder(chosen), force)
        try:
            sensors_file = folder / SENSORS_FILE if record_sensors else None
            result = _simulate(
                chosen, live=meshcat, host=host, recording=recording, sensors_file=sensors_file
            )
        finally:
            _remove_if_empty(folder)
        status = _write_and_report(folder, result)
    raise typer.Exit(status)


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _simulate(
    scenario: "Scenario", *, live: bool, host: str, recording: bool, sensors_file: Path | None
) -> "EpisodeResult":
    from tqdm import tqdm

    from diagrams.episode import run_episode
    from maths.compiled import compilation_timed

    viewer = _start_meshcat(host, announce=live) if live or recording else None
    bar = tqdm(
        total=scenario.duration,
        desc=f"{scenario.name}, seed {scenario.seed}",
        bar_format="{desc}: {percentage:3.0f}% |{bar}| {n:.1f}/{total:.1f} s simulated"
        " [{elapsed}<{remaining}]",
        disable=None,
    )

    def announce() -> None:
        bar.write("Compiling the filters' inner loops: a minute more, this first time.")

    with GentleInterrupt() as interrupt, bar, compilation_timed(announce):

        def progress(time: float) -> None:
            interrupt.check()
            bar.update(max(0.0, min(time, scenario.duration) - bar.n))

        result = run_episode(
            scenario, scenario.seed, meshcat=viewer, progress=progress, sensors_file=sensors_file
        )
        bar.total = bar.n  # An episode may end before its time is over.
        bar.refresh()
    return result


def _start_meshcat(host: str, *, announce: bool) -> Any:
    from diagrams.meshcat_view import start_meshcat

    meshcat = start_meshcat(host)
    if announce:
        typer.echo(f"Watch it at {meshcat.web_url()}")
    return meshcat


def _write_and_report(folder: Path, result: "EpisodeResult") -> int:
    """Writes the run, prints its report and returns the exit status."""
    import json

    from diagrams.run_folder import SUMMARY_FILE, write_run
    from diagrams.run_report import report

    written = write_run(folder, result)
    summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    typer.echo(report(result, summary, written))
    if result.interrupted:
        typer.echo(
            f"crossmodal: interrupted at {result.duration:.1f} s; the files above hold what was"
            " perceived until then",
            err=True,
        )
        return INTERRUPTED
    return 0 if result.failure is None else FAILED


@app.command(
    "replay",
    epilog="Example:  crossmodal run drawer --record-sensors --out runs/a, then"
    "  crossmodal replay runs/a --set 'perception.cut=[interacted_body_to_grasp]'",
)
def replay_command(
    run: Annotated[Path, typer.Argument(help="Folder of a run with --record-sensors.")],
    out: Annotated[Path | None, typer.Option(help="Folder. [default: RUN/replay]")] = None,
    force: ForceOption = False,
    overrides: SetOption = None,
) -> None:
    """Perceive a recorded run again, with other filters or other wires, without simulating."""
    with one_line_errors():
        from tqdm import tqdm

        from diagrams.replay import Wiring, load_recorded_scenario, replay
        from diagrams.run_folder import open_run_folder

        chosen = load_recorded_scenario(run, overrides or [])
        folder = open_run_folder(out or run / "replay", force)
        wirings = {
            name: Wiring(modality=name, cut=chosen.perception.cut) for name in chosen.modalities
        }
        with tqdm(desc=f"{chosen.name}, seed {chosen.seed}", unit="tick", disable=None) as bar:

            def progress(_: float) -> None:
                bar.update()

            result = replay(run, chosen, wirings, progress)
        status = _write_and_report(folder, result)
    raise typer.Exit(status)


@app.command(
    "evaluate",
    epilog="Examples:  crossmodal evaluate drawer --seeds 100:120 --jobs 2   |"
    "   crossmodal evaluate all --seeds 20.  Run it again to go on where it was stopped.",
)
def evaluate_command(
    experiment: Annotated[str, typer.Argument(help="See 'crossmodal list'; 'all' for all.")],
    seeds: Annotated[
        str, typer.Option(help="Like 20 (from 100 on), 100:120 (without 120) or 1,4,9.")
    ] = "20",
    jobs: Annotated[int, typer.Option(min=1, help="Episodes at a time, one process each.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results. [default: runs/evaluate/NAME]")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start afresh where the folder has other results.")
    ] = False,
    backend: Annotated[
        str, typer.Option(help="'processes' on this machine, or 'ray' for a cluster.")
    ] = "processes",
    address: Annotated[
        str, typer.Option(help="Of the Ray cluster. [default: the one on this machine]")
    ] = "",
    overrides: SetOption = None,
) -> None:
    """Repeat an experiment over seeds and write tables and plots beside the paper's figures."""
    with one_line_errors():
        from diagrams import experiment_report as reports
        from diagrams.experiment_runner import Workers, connect, prepare
        from diagrams.experiments import ALL, find_experiments, parse_seeds

        chosen = find_experiments(experiment)
        numbers = parse_seeds(seeds)
        root = Path("runs") / "evaluate"
        if experiment == ALL:
            top = out or root
            folders = {name: top / name for name in chosen}
        else:
            folders = {experiment: out or root / experiment}
        workers = Workers(jobs=jobs, backend=backend, address=address)
        connect(workers)
        evaluations = [
            prepare(name, one, numbers, folders[name], overrides=overrides or [], force=force)
            for name, one in chosen.items()
        ]
        origin = reports.made_by(
            " ".join(
                ["crossmodal evaluate", experiment, f"--seeds {seeds} --jobs {jobs}"]
                + [f"--set {assignment}" for assignment in overrides or []]
            )
        )
        written: list[Path] = []
        finished = True
        for evaluation in evaluations:
            finished = finished and _run_evaluation(evaluation, workers)
            written = reports.write_experiment(evaluation, origin) or written
        if experiment == ALL:
            written = reports.write_overview(evaluations, top, origin)
    summaries = [summary for evaluation in evaluations for summary in evaluation.summaries]
    _finish_evaluation(summaries, written, not finished)


def _run_evaluation(evaluation: "Evaluation", workers: "Workers") -> bool:
    """Runs an experiment behind a progress bar; returns False where it was interrupted."""
    from tqdm import tqdm

    from diagrams.experiment_runner import run

    total = len(evaluation.scenarios)
    with tqdm(total=total, desc=evaluation.name, unit="episode", disable=None) as bar:
        done = 0

        def progress(summary: dict[str, Any]) -> None:
            nonlocal done
            done += bool(summary["success"])
            bar.update()
            bar.set_postfix_str(f"{done} of {bar.n} done")
            if not summary["success"]:
                reason = f"{evaluation.name}, seed {summary['seed']}: {summary['failure']}"
                bar.write(reason, file=sys.stderr)

        return run(evaluation, workers, progress)


def _finish_evaluation(
    summaries: list[dict[str, Any]], written: list[Path], interrupted: bool
) -> None:
    for path in written:
        if path.suffix == ".md":
            typer.echo(path.read_text(encoding="utf-8"))
    for path in written:
        typer.echo(f"  {path}")
    if interrupted:
        typer.echo(
            f"crossmodal: interrupted after {len(summaries)} episode(s); the same command goes on",
            err=True,
        )
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if all(summary["success"] for summary in summaries) else FAILED)


@app.command("ablate", epilog="Example:  crossmodal ablate body-in-the-hand --seeds 0:5")
def ablate_command(
    names: Annotated[
        list[str] | None, typer.Argument(help="Flows to cut. [default: all of them]")
    ] = None,
    seeds: Annotated[str, typer.Option(help="Like 0:3 (without 3), 7 or 1,4,9.")] = "0:3",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/ablations"),
) -> None:
    """Cut the wires between the senses, one at a time, and write what that costs."""
    with one_line_errors():
        from tqdm import tqdm

        from diagrams.ablations import ABLATIONS, find_ablation, run_ablations
        from diagrams.experiments import parse_seeds
        from diagrams.run_folder import write_text

        chosen, numbers = names or list(ABLATIONS), parse_seeds(seeds)
        for name in chosen:
            find_ablation(name)
        with tqdm(total=len(chosen) * len(numbers), unit="episode", disable=None) as bar:
            table = run_ablations(chosen, numbers, out, bar.update)
        typer.echo(f"{table}\n  {write_text(out / 'ablations.md', table)}")


@train_app.command(
    "hand-bending", epilog="Example:  crossmodal train hand-bending --jobs 2 --search"
)
def train_hand_bending_command(
    search: Annotated[
        bool, typer.Option("--search", help="Also compare topologies by leave-one-out.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of data and weights.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Interactions simulated at a time.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of weights and card. [default: models/weights]")
    ] = None,
) -> None:
    """Train the networks that read the soft hand's bending from wrench and air pressure."""
    with one_line_errors():
        from tqdm import tqdm

        from diagrams.network_training import (
            INTERACTIONS,
            simulate_interactions,
            train_hand_bending,
        )

        simulated = tqdm(
            simulate_interactions(seed, jobs=jobs),
            total=INTERACTIONS,
            desc="interactions",
            disable=None,
        )
        interactions = list(simulated)
        typer.echo("Training ..." + (" and comparing topologies ..." if search else ""))
        written, card = train_hand_bending(interactions, seed=seed, search=search, folder=out)
        typer.echo(f"\n{card}")
        for path in written:
            typer.echo(f"  {path}")


@app.command(
    "diagram", epilog="Example:  crossmodal diagram drawer --modality vision --out vision.svg"
)
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
        from diagrams.episode import build_networks, build_station
        from diagrams.network_drawing import network_dot, render_svg
        from diagrams.palette import MODALITY_LABEL
        from diagrams.run_folder import write_text
        from diagrams.scenario import MODALITIES, load_scenario
        from diagrams.yaml_schema import ScenarioError, suggestion

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


def main() -> int:
    """Entry point of the `crossmodal` command; bad options, too, are answered in one line."""
    try:
        status = app(prog_name="crossmodal", standalone_mode=False)
    except Exception as error:
        # Typer's usage errors come from its own or from an installed click; both format alike.
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        is_help = "\n" in message
        typer.echo(message if is_help else f"crossmodal: {message}", err=not is_help)
        return BAD_INPUT
    return int(status or 0)


if __name__ == "__main__":
    sys.exit(main())
