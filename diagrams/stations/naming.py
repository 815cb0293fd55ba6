"""Names and seeds of the parts of a station of which there are several."""

from collections.abc import Collection

from crossmodal.systems.sensors.randomness import make_generator


def prefixed(owner: str, name: str) -> str:
    """The name of a port or system of one of several arms, hands or cameras.

    Args:
        owner: Which one; empty where there is only one, whose names stay as they are.
        name: What it is called without an owner.
    """
    return f"{owner}_{name}" if owner else name


def owner_among(name: str, names: Collection[str]) -> str:
    """The owner of what belongs to `name`: empty where `names` has no other."""
    return name if len(names) > 1 else ""


def own_seed(seed: int, owner: str) -> int:
    """The seed of one owner's noise, so that two sensors of a kind do not err alike."""
    return int(make_generator(seed, owner).integers(2**31)) if owner else seed
