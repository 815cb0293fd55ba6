"""The `crossmodal` command. What a command needs is imported when it runs, so help is instant."""

import signal
import sys
from importlib.metadata import version
from types import FrameType
from typing import Annotated

import typer

from crossmodal.diagrams.commands import (
    ablate,
    compare,
    diagram,
    evaluate,
    export,
    inspect,
    joints,
    list_names,
    pose,
    replay,
    run,
    show,
    stream,
    train,
)
from crossmodal.diagrams.commands.endings import BAD_INPUT
from crossmodal.diagrams.commands.scenario_help import CommandOfScenario

app = typer.Typer(
    help="Interactive perception in Drake: a robot moves something and reads what vision,"
    " proprioception and touch say together.",
    epilog="Start with:  crossmodal run drawer",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
train_app = typer.Typer(
    help="Make the training data in simulation and train a small network on them.",
    epilog=train.EXAMPLES,
    no_args_is_help=True,
    rich_markup_mode=None,
)


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"crossmodal {version('crossmodal')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    pass


app.command("list", epilog=list_names.EXAMPLES)(list_names.list_command)
app.command("show", epilog=show.EXAMPLES)(show.show_command)
app.command("run", epilog=run.EXAMPLES, cls=CommandOfScenario)(run.run_command)
app.command("inspect", epilog=inspect.EXAMPLES)(inspect.inspect_command)
app.command("replay", epilog=replay.EXAMPLES)(replay.replay_command)
app.command("export", epilog=export.EXAMPLES)(export.export_command)
app.command("stream", epilog=stream.EXAMPLES)(stream.stream_command)
app.command("evaluate", epilog=evaluate.EXAMPLES)(evaluate.evaluate_command)
app.command("ablate", epilog=ablate.EXAMPLES)(ablate.ablate_command)
app.command("compare", epilog=compare.EXAMPLES)(compare.compare_command)
train_app.command("hand-bending", epilog=train.EXAMPLES)(train.train_hand_bending_command)
train_app.command("segmentation", epilog=train.SEGMENTATION_EXAMPLES)(
    train.train_segmentation_command
)
train_app.command("grasp", epilog=train.GRASP_EXAMPLES)(train.train_grasp_command)
app.add_typer(train_app, name="train")
app.command("pose", epilog=pose.EXAMPLES)(pose.pose_command)
app.command("joints", epilog=joints.EXAMPLES)(joints.joints_command)
app.command("diagram", epilog=diagram.EXAMPLES)(diagram.diagram_command)


def main() -> int:
    """Entry point of the `crossmodal` command; bad options, too, are answered in one line.

    Whoever ends it by SIGTERM gets what Ctrl-C gives: what is finished is kept.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        status = app(prog_name="crossmodal", standalone_mode=False)
    except Exception as error:
        # Typer's usage errors come from its own or from an installed click; both format alike.
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        is_help = "\n" in message
        typer.echo(
            message if is_help else f"crossmodal: {message.rstrip('.')}{_help_of(error)}",
            err=not is_help,
        )
        return BAD_INPUT
    return int(status or 0)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Does what Ctrl-C does, also in a shell's background, where that is ignored."""
    handler = signal.getsignal(signal.SIGINT)
    (handler if callable(handler) else signal.default_int_handler)(number, frame)


def _help_of(error: Exception) -> str:
    """Where the command that was misused is explained."""
    context = getattr(error, "ctx", None)
    return "" if context is None else f"; see '{context.command_path} --help'"


if __name__ == "__main__":
    sys.exit(main())
