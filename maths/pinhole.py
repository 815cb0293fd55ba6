"""The pinhole camera: pixels and points."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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

    def rays(self, pixels: Array, X_WC: Array) -> Array:
        """From the camera through pixels (N, 2) to where their depth is one (N, 3), in W.

        Args:
            pixels: u and v.
            X_WC: Of the camera (4, 4).
        """
        x, y = ((pixels - [self.center_x, self.center_y]) / [self.focal_x, self.focal_y]).T
        return np.stack([a * x + b * y + c for a, b, c in X_WC[:3, :3]], axis=-1)

    def image_rays(self, X_WC: Array) -> Array:
        """The rays of all pixels (H, W, 3)."""
        return np.stack([self._along(axis, X_WC) for axis in range(3)], axis=-1)

    def descents(self, X_WC: Array) -> Array:
        """By how much the rays of all pixels go down in W (H, W), per depth."""
        return -self._along(2, X_WC)

    def heights(self, depth: npt.NDArray[np.floating], X_WC: Array, plane: float) -> Array:
        """Heights (H, W) above a level plane of what is seen, [m]; NaN without a measurement.

        Args:
            depth: (H, W) along the camera's axis, [m]; zero, NaN or infinite where nothing was
                measured.
            X_WC: Of the camera (4, 4) in W, whose z is up.
            plane: z of the plane in W, [m].
        """
        known = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan)
        return np.asarray(X_WC[2, 3] - plane - known * self.descents(X_WC))

    def _along(self, axis: int, X_WC: Array) -> Array:
        """Components (H, W) of the rays of all pixels."""
        a, b, c = X_WC[axis, :3]
        x = (np.arange(self.width) - self.center_x) / self.focal_x
        y = (np.arange(self.height) - self.center_y) / self.focal_y
        return np.asarray(a * x + (b * y + c)[:, None])


def project(p_CF: Array, intrinsics: Array) -> Array:
    """Pixels (N, 2) of points (N, 3); NaN where a point is not in front of the camera.

    Args:
        p_CF: In the camera's frame, x right, y down, z forward, [m].
        intrinsics: (4,), see `Intrinsics.vector`.
    """
    z = np.where(p_CF[:, 2] > 1e-3, p_CF[:, 2], np.nan)
    return np.asarray(p_CF[:, :2] / z[:, None] * intrinsics[:2] + intrinsics[2:])
