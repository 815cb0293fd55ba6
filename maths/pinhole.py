"""The pinhole camera: pixels and points."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Ids


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
        return self._rays(pixels[:, 0], pixels[:, 1], X_WC)

    def image_rays(self, X_WC: Array) -> Array:
        """The rays of all pixels (H, W, 3)."""
        return self._rays(np.arange(self.width), np.arange(self.height)[:, None], X_WC)

    def heights(self, depth: npt.NDArray[np.floating], X_WC: Array, plane: float) -> Array:
        """Heights (H, W) above a level plane of what is seen, [m]; NaN without a measurement.

        Args:
            depth: (H, W) along the camera's axis, [m]; zero, NaN or infinite where nothing was
                measured.
            X_WC: Of the camera (4, 4) in W, whose z is up.
            plane: z of the plane in W, [m].
        """
        known = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan)
        return np.asarray(X_WC[2, 3] - plane + known * self.image_rays(X_WC)[..., 2])

    def _rays(self, u: Array | Ids, v: Array | Ids, X_WC: Array) -> Array:
        x, y = (u - self.center_x) / self.focal_x, (v - self.center_y) / self.focal_y
        return np.stack([a * x + b * y + c for a, b, c in X_WC[:3, :3]], axis=-1)


def project(p_CF: Array, intrinsics: Array) -> Array:
    """Pixels (N, 2) of points (N, 3); NaN where a point is not in front of the camera.

    Args:
        p_CF: In the camera's frame, x right, y down, z forward, [m].
        intrinsics: (4,), see `Intrinsics.vector`.
    """
    z = np.where(p_CF[:, 2] > 1e-3, p_CF[:, 2], np.nan)
    return np.asarray(p_CF[:, :2] / z[:, None] * intrinsics[:2] + intrinsics[2:])
