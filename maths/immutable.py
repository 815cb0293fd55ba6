"""Values that Drake may hold in a Context without copying them."""

from typing import Self


class Immutable:
    """Never written after it is made, so that a copy is the object itself.

    Drake copies abstract state three times per update; this makes these copies free. Updates make
    a new object, for example by `dataclasses.replace`.
    """

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self
