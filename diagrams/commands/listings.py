"""What there is to be run, found without importing the applications that come along."""

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
