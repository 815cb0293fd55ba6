"""How Drake's renderers describe a pinhole camera."""

from pydrake.systems.sensors import CameraInfo

from crossmodal.maths.pinhole import Intrinsics

# Drake renders the centre of the upper left pixel at (0.5, 0.5) of a `CameraInfo`, which a test
# measures; without this correction a point is off by 0.2 mm per 22 cm towards the camera.
_PIXEL_CENTRE = 0.5


def renderer_intrinsics(intrinsics: Intrinsics) -> CameraInfo:
    """Intrinsics for a renderer whose images are then those of a camera with the given ones."""
    return CameraInfo(
        intrinsics.width,
        intrinsics.height,
        intrinsics.focal_x,
        intrinsics.focal_y,
        intrinsics.center_x + _PIXEL_CENTRE,
        intrinsics.center_y + _PIXEL_CENTRE,
    )
