"""Where the camera is and what it sees."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from maths.arrays import Array


def camera_intrinsics(width: int, height: int, horizontal_angle: float) -> CameraInfo:
    """A pinhole camera with square pixels; `horizontal_angle` in [rad]."""
    focal = 0.5 * width / np.tan(0.5 * horizontal_angle)
    return CameraInfo(width, height, focal, focal, 0.5 * width - 0.5, 0.5 * height - 0.5)


def looking_at(p_WC: Array, p_WTarget: Array) -> RigidTransform:
    """X_WC of an upright camera at `p_WC` (3,) that looks at `p_WTarget` (3,)."""
    z = (p_WTarget - p_WC) / np.linalg.norm(p_WTarget - p_WC)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_WC)
