"""Light and cover of a scenario's cameras on the live page."""

from collections.abc import Collection

from crossmodal.diagrams.run.live.controls import Control
from crossmodal.diagrams.stations.naming import owner_among, prefixed

LIGHT, COVER = "light_by_hand", "cover_by_hand"


def camera_controls(cameras: Collection[str]) -> list[Control]:
    """How much light each camera has, and whether it is covered."""
    controls = []
    for name in cameras:
        owner = owner_among(name, cameras)
        of = f" of {owner}" if owner else ""
        light, cover = prefixed(owner, LIGHT), prefixed(owner, COVER)
        controls += [
            Control(name=f"light{of}", port=light, low=0.0, high=1.0, step=0.05, value=1.0),
            Control(name=f"cover{of}", port=cover, low=0.0, high=1.0, step=1.0, value=0.0),
        ]
    return controls
