"""Light and cover of a scenario's cameras on the live page."""

from collections.abc import Collection

from crossmodal.diagrams.run.live.controls import Control, ControlKind
from crossmodal.diagrams.stations.add_cameras import COVER, LIGHT
from crossmodal.diagrams.stations.naming import owner_among, prefixed


def camera_controls(cameras: Collection[str], *, colour_is_read: bool) -> list[Control]:
    """How much light each camera has, and whether it is covered.

    Args:
        cameras: Their names.
        colour_is_read: Whether something perceives by colour; depth does not depend on light.
    """
    controls = []
    for name in cameras:
        owner = owner_among(name, cameras)
        of = f" of {owner}" if owner else ""
        light, cover = prefixed(owner, LIGHT), prefixed(owner, COVER)
        if colour_is_read:
            controls.append(
                Control(
                    name=f"light{of} [%]", port=light, high=100.0, step=5.0, value=100.0,
                    factor=0.01,
                )
            )  # fmt: skip
        controls.append(Control(name=f"cover{of}", port=cover, kind=ControlKind.SWITCH))
    return controls
