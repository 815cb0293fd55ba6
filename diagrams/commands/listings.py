"""What there is to be run, found without importing the applications that come along."""

import glob
import importlib
import os
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crossmodal.diagrams.run.listing import Listing

COME_ALONG = ("crossmodal", "flap", "clutter")


def listings() -> tuple["Listing", ...]:
    """Of all applications, those that come along first; others are imported for it."""
    from crossmodal.diagrams.run.listing import Listing

    modules = (f"crossmodal.diagrams.{name}.listing" for name in COME_ALONG)
    found = [importlib.import_module(module).LISTING for module in modules]
    if not os.environ.get("CROSSMODAL_APPLICATIONS") and not entry_points(
        group="crossmodal.applications"
    ):
        return tuple(found)
    from crossmodal.diagrams.applications import applications

    own = [
        Listing(
            name=name,
            description=application.description,
            scenarios=application.scenarios,
            experiments=application.experiments,
        )
        for name, application in applications().items()
        if name not in COME_ALONG
    ]
    return (*found, *own)


def _files(incomplete: str) -> list[tuple[str, str]]:
    paths = glob.glob(f"{glob.escape(incomplete)}*")
    return [(f"{path}/" if os.path.isdir(path) else path, "") for path in sorted(paths)]


def complete_scenario(incomplete: str) -> list[tuple[str, str]]:
    """Scenarios, with what they are, and files, that begin so."""
    from crossmodal.diagrams.run.listing import description_of

    known = {name: path for one in listings() for name, path in one.files().items()}
    names = [
        (name, description_of(path, known))
        for name, path in known.items()
        if name.startswith(incomplete)
    ]
    return names or _files(incomplete)


def complete_experiment(incomplete: str) -> list[tuple[str, str]]:
    """Experiments that begin so, with what they are."""
    known = {name: one.description for all_ in listings() for name, one in all_.experiments.items()}
    known["all"] = "every experiment"
    return [(name, text) for name, text in known.items() if name.startswith(incomplete)]


def complete_connection(incomplete: str) -> list[tuple[str, str]]:
    """Connections between the senses that begin so, with what they carry."""
    from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS

    return [(name, one.flow) for name, one in ABLATIONS.items() if name.startswith(incomplete)]
