"""Help that leaves out what a scenario's application has no use for."""

from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperOption

from crossmodal.diagrams.commands.completion import silent
from crossmodal.diagrams.commands.listings import listings

_OF_OBJECTS = ("own_object", "grasp_frame", "joint", "pull_direction", "object_pose", "scale")


class CommandOfScenario(TyperCommand):
    """A command whose help, after a scenario's name, has only the options of its application.

    `crossmodal run --help` shows all of them, `crossmodal run flap --help` those for the flap.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not {"-h", "--help"}.isdisjoint(args):
            found = None
            with silent():  # What is wrong is said where the scenario is loaded.
                given, *_ = self.make_parser(ctx).parse_args(list(args))
                found = _listing_of(given.get("scenario"))
            for option in self.params:
                if isinstance(option, TyperOption) and option.name in _OF_OBJECTS:
                    option.hidden = found is not None and option.name not in _options(found)
        return super().parse_args(ctx, args)


def _listing_of(scenario: Any) -> Any:
    """The listing of the application that a scenario, by its name or its file, is for."""
    if not isinstance(scenario, str):
        return None
    from crossmodal.diagrams.run.listing import said_in

    every = listings()
    known = {name: path for one in every for name, path in one.files().items()}
    if scenario in known:
        return next(one for one in every if scenario in one.files())
    system = said_in(Path(scenario), "system", known)
    return next((one for one in every if one.name == system), None)


def _options(listing: Any) -> tuple[str, ...]:
    of_object = listing.object_options
    return () if of_object is None else ("own_object", *of_object)
