"""`crossmodal export`."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crossmodal.diagrams.commands.completion import complete_from
from crossmodal.diagrams.commands.endings import one_line_errors
from crossmodal.diagrams.commands.options import ForceOption

if TYPE_CHECKING:
    from crossmodal.diagrams.run.application import Application
    from crossmodal.diagrams.run.folder.perceived_file import Perceived

_BAGS = ("bag", "mcap", "db3")  # Of ROS 1, of ROS 2 and again of ROS 2.

EXAMPLES = (
    "Examples:  crossmodal run drawer --out runs/a, then  crossmodal export runs/a --to urdf"
    "   |   crossmodal export runs/a --to sdf --estimator vision --out seen.sdf"
)


def export_command(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    to: Annotated[
        str,
        typer.Option(
            metavar="urdf|sdf|bag|mcap|db3",
            help="A model of the object; or the sensor streams as a bag of ROS 1 or 2.",
            autocompletion=complete_from("urdf", "sdf", *_BAGS),
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="File. [default: RUN/object.urdf or .sdf, RUN/streams.bag, ...]"),
    ] = None,
    estimator: Annotated[
        str, typer.Option(help="Whose estimates. [default: those that the robot acted by]")
    ] = "",
    force: ForceOption = False,
) -> None:
    """Write the object as a run perceived it as a model, or what its sensors measured as a bag."""
    with one_line_errors():
        from crossmodal.diagrams.applications import load_scenario
        from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE
        from crossmodal.diagrams.run.folder.written_files import write_text
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
        from crossmodal.systems.object_models.model_text import as_name
        from crossmodal.systems.object_models.sdf import sdf
        from crossmodal.systems.object_models.urdf import urdf

        if to in _BAGS:
            if estimator:
                raise ScenarioError(
                    f"--estimator = '{estimator}': a bag (--to {to}) holds no estimates"
                )
            path = _export_bag(run, out or run / f"streams.{to}", to, force=force)
            typer.echo(f"{path}: what the sensors measured")
            return
        writers = {"urdf": urdf, "sdf": sdf}
        if to not in writers:
            raise ScenarioError(f"--to = '{to}', need one of {', '.join([*writers, *_BAGS])}")
        path = out or run / f"object.{to}"
        if path.exists() and not force:
            raise ScenarioError(f"{path}: exists already; replace it with --force, or name --out")
        if not (run / SCENARIO_FILE).is_file():
            raise ScenarioError(f"{run}: holds no {SCENARIO_FILE}; name the folder of a run")
        application, scenario = load_scenario(str(run / SCENARIO_FILE))
        if application.perceived is None:
            raise ScenarioError(
                f"{run}: the application '{application.name}' perceives no articulated object"
            )
        known = _perceived(run, application, scenario).estimators
        if not known:
            raise ScenarioError(f"{run}: no joint was perceived, so that there is none to write")
        acting = application.acting(scenario)
        chosen = estimator or (acting if acting in known else next(iter(known)))
        if chosen not in known:
            raise ScenarioError(f"--estimator = '{chosen}': {suggestion(chosen, known)}")
        try:
            model = writers[to](known[chosen], as_name(scenario.name))
        except ValueError as error:
            raise ScenarioError(f"{run}: {error}") from None
        typer.echo(f"{write_text(path, model)}: as '{chosen}' perceived it")


def _export_bag(run: Path, path: Path, kind: str, *, force: bool) -> Path:
    from crossmodal.diagrams.recordings.export_bag import export_bag
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    replaceable = force and path.is_file() and not path.is_symlink()
    if os.path.lexists(path) and not replaceable:
        raise ScenarioError(f"{path}: exists already; name another with --out")
    return export_bag(run, path, kind)


def _perceived(run: Path, application: "Application", scenario: Any) -> "Perceived":
    """What the run has kept; a recording that nobody has perceived is perceived now."""
    from tqdm import tqdm

    from crossmodal.diagrams.run.folder.perceived_file import (
        PERCEIVED_FILE,
        perceived,
        read_perceived,
    )
    from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE
    from crossmodal.diagrams.run.replay import replay
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

    if (run / PERCEIVED_FILE).is_file():
        return read_perceived(run)
    if not (run / SENSORS_FILE).is_file():
        raise ScenarioError(f"{run}: holds no {PERCEIVED_FILE} or {SENSORS_FILE}; run it again")
    with tqdm(desc="perceiving the recording", unit="tick", disable=None) as bar:

        def progress(_: float) -> None:
            bar.update()

        record = replay(application, run, scenario, progress=progress)
    return perceived(application, record)
