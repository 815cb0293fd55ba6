"""Where a camera is and what it sees."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from maths.arrays import Array


@dataclass(kw_only=True)
class MountedCamera:
    """A camera on a frame P, as it is or as the robot believes it to be.

    Attributes:
        intrinsics: Of its images.
        X_PC: Pose of C (x right, y down, z forward).
        base_frame: P, a frame of a model (`model::frame`) or the world.
    """

    intrinsics: CameraInfo
    X_PC: RigidTransform
    base_frame: str = "world"


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
