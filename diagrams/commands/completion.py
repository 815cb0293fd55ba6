"""What a shell completes an argument or option from. It prints nothing, whatever goes wrong."""

import contextlib
import glob
import io
import os
from collections.abc import Callable, Iterator
from typing import Any

import typer

from crossmodal.diagrams.commands.listings import listings

Words = list[tuple[str, str]]  # With what they are.


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Ends what is within at any error; nothing of it is printed amid what the shell shows."""
    nowhere = io.StringIO()
    with (
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
        contextlib.suppress(Exception, SystemExit),
    ):
        yield


def complete_scenario(incomplete: str) -> Words:
    """Scenarios, with what they are, and files, that begin so."""
    names: Words = []
    with silent():
        from crossmodal.diagrams.run.listing import description_of

        known = {name: path for one in listings() for name, path in one.files().items()}
        found = [name for name in known if name.startswith(incomplete)]
        names = [(name, description_of(known[name], known)) for name in found]
    return names or _files(incomplete)


def _files(incomplete: str) -> Words:
    paths = glob.glob(f"{glob.escape(incomplete)}*")
    return [(f"{path}/" if os.path.isdir(path) else path, "") for path in sorted(paths)]


def complete_experiment(incomplete: str) -> Words:
    """Experiments that begin so, with what they are."""
    known: dict[str, str] = {}
    with silent():
        every = (all_.experiments.items() for all_ in listings())
        known = {name: one.description for some in every for name, one in some}
    known["all"] = "every experiment"
    return [(name, text) for name, text in known.items() if name.startswith(incomplete)]


def complete_connection(incomplete: str) -> Words:
    """Connections between the senses that begin so, with what they carry."""
    known: dict[str, str] = {}
    with silent():
        from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS

        known = {name: one.flow for name, one in ABLATIONS.items()}
    return [(name, flow) for name, flow in known.items() if name.startswith(incomplete)]


def complete_key(ctx: typer.Context, incomplete: str) -> Words:
    """Keys of the values of the command's scenario that begin so, with what they mean."""
    lines: Words = []
    with silent():
        from crossmodal.diagrams.run.yaml_input.values_table import values_table

        lines = [(line.key, line.meaning) for line in values_table(_loaded(ctx)[1])]
    return [(key, meaning) for key, meaning in lines if key.startswith(incomplete)]


def complete_modalities(ctx: typer.Context, incomplete: str) -> Words:
    """Estimators of the command's scenario, with commas between them, the last of which begins so.

    Before it stand those that are written already.
    """
    *written, last = incomplete.split(",")
    found: Words = []
    with silent():
        application, scenario = _loaded(ctx)
        labels = application.labels
        found = [(name, labels.get(name, "")) for name in scenario.modalities]
    return [
        (",".join([*written, name]), label)
        for name, label in found
        if name.startswith(last) and name not in written
    ]


def complete_from(*words: str) -> Callable[[str], list[str]]:
    """What completes one of these words."""

    def complete(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return complete


def _loaded(ctx: typer.Context) -> tuple[Any, Any]:
    """Application and scenario of the command line so far, whose first argument names it."""
    from crossmodal.diagrams.applications import experiments, load_scenario
    from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE

    # The arguments are not sorted yet where an option waits for what is being completed.
    given = (ctx.params.get(name) for name in ("scenario", "run", "experiment"))
    name = str(next(filter(None, given), None) or ctx.args[0])
    if "experiment" in ctx.params:
        name = experiments()[name].experiments[name].scenario
    return load_scenario(os.path.join(name, SCENARIO_FILE) if os.path.isdir(name) else name)
