"""`crossmodal replay`."""

import warnings
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import FAILED, INTERRUPTED, one_line_errors
from crossmodal.diagrams.commands.options import (
    ForceOption,
    QuietOption,
    SetOption,
    StreamOption,
    VerboseOption,
)
from crossmodal.diagrams.commands.run_log import RunLog
from crossmodal.diagrams.commands.run_output import streaming, write_and_report

EXAMPLES = (
    "Examples:  crossmodal run drawer --record-sensors --out runs/a, then"
    "  crossmodal replay runs/a --set 'perception.cut=[held_body_to_grasp]'"
    "   |   crossmodal replay kitchen.bag --robot wam --calibration my.yaml --topics map.yaml"
)


def replay_command(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|RECORDING",
            help="Folder of a run with --record-sensors; or a recording of a real robot: a ROS 1 or"
            " ROS 2 bag, an MCAP file, or a folder of the RBO data set.",
        ),
    ],
    robot: Annotated[
        str, typer.Option(metavar="wam", help="Of a recording: which robot it is of.")
    ] = "",
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Of a recording: where its camera and arm are; see `inspect`."
        ),
    ] = None,
    topics: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Of a recording: which topic is what. [default: by names and types]",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder. [default: RUN/replay, or the next free number]")
    ] = None,
    force: ForceOption = False,
    stream: StreamOption = "",
    overrides: SetOption = None,
    verbose: VerboseOption = False,
    quiet: QuietOption = False,
) -> None:
    """Perceive a recorded run again, or a recording of a real robot, without simulating."""
    log = RunLog(verbose=verbose, quiet=quiet)
    with one_line_errors(log):
        from crossmodal.systems.recordings.open_recording import is_recording

        log.begin("Loading the estimators and the recording")
        if not (run / "scenario.yaml").exists() and is_recording(run):
            status = _replay_recording(
                run, robot, calibration, topics, out, stream, overrides or [], log, force=force
            )
            raise typer.Exit(status)
        _refuse_of_recordings(run, robot, calibration, topics)
        from tqdm import tqdm

        from crossmodal.diagrams.applications import load_recorded
        from crossmodal.diagrams.run.folder.run_folder import opened
        from crossmodal.diagrams.run.replay import replay
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        application, chosen = load_recorded(run, overrides or [])
        if out is not None and out.resolve() == run.resolve():
            raise ScenarioError(f"--out {out}: holds the recorded run itself; choose another")
        numbered = out is None and not force
        with opened(out or run / "replay", force=force, numbered=numbered) as folder:
            title = f"{chosen.name}, seed {chosen.seed}"
            with (
                streaming(stream, log, force=force) as sink,
                tqdm(desc=title, unit="tick", disable=True if quiet else None) as bar,
            ):

                def progress(_: float) -> None:
                    bar.update()

                record = replay(application, run, chosen, progress=progress, sink=sink)
            status = write_and_report(folder, application, record, log)
            if status == INTERRUPTED:  # Not this command, but the run that it replays.
                status = FAILED
    raise typer.Exit(status)


def _refuse_of_recordings(
    run: Path, robot: str, calibration: Path | None, topics: Path | None
) -> None:
    """A run says itself what its streams are."""
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    given = {"--robot": robot, "--calibration": calibration, "--topics": topics}
    for option, value in given.items():
        if value:
            raise ScenarioError(f"{option} is for recordings of real robots; {run} is none")


def _replay_recording(
    path: Path,
    robot: str,
    calibration: Path | None,
    topics: Path | None,
    out: Path | None,
    stream: str,
    overrides: list[str],
    log: RunLog,
    *,
    force: bool,
) -> int:
    """Replays what is no run of this program; returns the exit status."""
    from tempfile import TemporaryDirectory

    from pydrake.common.yaml import yaml_dump_typed
    from tqdm import tqdm

    from crossmodal.diagrams.recordings.calibration_file import read_calibration
    from crossmodal.diagrams.recordings.replay_recording import (
        CALIBRATION_FILE,
        TOPICS_FILE,
        RecordingWarning,
        prepare,
    )
    from crossmodal.diagrams.recordings.survey import survey
    from crossmodal.diagrams.recordings.topic_map import likely_topic_map, read_topic_map
    from crossmodal.diagrams.run.folder.run_folder import opened
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
    from crossmodal.systems.recordings.recording import RecordingError

    if not robot or calibration is None:
        raise ScenarioError(
            f"{path}: is a recording; name --robot wam and --calibration FILE, of which"
            f" `crossmodal inspect {path} --drafts .` writes a draft"
        )
    hidden = True if log.is_quiet else None
    try:
        known = read_calibration(calibration)
        place, numbered = out or Path("runs") / f"{path.stem}-replay", out is None and not force
        with (
            TemporaryDirectory() as copies,
            opened(place, force=force, numbered=numbered) as folder,
            streaming(stream, log, force=force) as sink,
        ):
            with tqdm(desc="reading", unit="messages", leave=False, disable=hidden) as bar:
                found = survey(path, lambda _: bar.update())
            chosen = likely_topic_map(found) if topics is None else read_topic_map(topics, found)
            kept = {CALIBRATION_FILE: Path(copies, "0"), TOPICS_FILE: Path(copies, "1")}
            for file, used in zip(kept.values(), (known, chosen), strict=True):
                file.write_text(yaml_dump_typed(used), encoding="utf-8")
            ready = prepare(found, chosen, known, robot, overrides, kept)
            for line in ready.warnings:
                warnings.warn(line, RecordingWarning, stacklevel=1)
            with tqdm(desc=path.stem, unit="tick", disable=hidden) as bar:

                def progress(_: float) -> None:
                    bar.update()

                record = ready.run(progress, sink)
            return write_and_report(folder, ready.application, record, log)
    except RecordingError as error:
        raise ScenarioError(str(error)) from None
