"""The pinhole camera: pixels and points."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole camera without distortion, as OpenCV and ROS describe it.

    The centre of the upper left pixel has the coordinates (0, 0); u goes to the right, v down.

    Attributes:
        width: [px]
        height: [px]
        focal_x: [px]
        focal_y: [px]
        center_x: Of the principal point, [px].
        center_y: Likewise.
    """

    width: int
    height: int
    focal_x: float
    focal_y: float
    center_x: float
    center_y: float

    def vector(self) -> Array:
        """(focal_x, focal_y, center_x, center_y), [px]."""
        return np.array([self.focal_x, self.focal_y, self.center_x, self.center_y])

    def project(self, p_CF: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the camera's frame C; see `project`."""
        return project(p_CF, self.vector())


def project(p_CF: Array, intrinsics: Array) -> Array:
    """Pixels (N, 2) of points (N, 3); NaN where a point is not in front of the camera.

    Args:
        p_CF: In the camera's frame, x right, y down, z forward, [m].
        intrinsics: (4,), see `Intrinsics.vector`.
    """
    z = np.where(p_CF[:, 2] > 1e-3, p_CF[:, 2], np.nan)
    return np.asarray(p_CF[:, :2] / z[:, None] * intrinsics[:2] + intrinsics[2:])
