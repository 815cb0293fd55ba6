"""Help that leaves out what a scenario's application has no use for."""

from typing import Any

from typer.core import TyperCommand, TyperOption

from crossmodal.diagrams.commands.listings import listings

_OF_OBJECTS = ("own_object", "grasp_frame", "joint", "pull_direction", "object_pose", "scale")


class CommandOfScenario(TyperCommand):
    """A command whose help, after a scenario's name, has only the options of its application.

    `crossmodal run --help` shows all of them, `crossmodal run flap --help` those for the flap.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        wants_help = not {"-h", "--help"}.isdisjoint(args)
        names = [text for text in args if not text.startswith("-")] if wants_help else []
        found = [one for one in listings() if names[0] in one.files()] if names else []
        for option in self.params:
            if isinstance(option, TyperOption) and option.name in _OF_OBJECTS:
                option.hidden = any(option.name not in _options(one) for one in found)
        return super().parse_args(ctx, args)


def _options(listing: Any) -> tuple[str, ...]:
    of_object = listing.object_options
    return () if of_object is None else ("own_object", *of_object)
