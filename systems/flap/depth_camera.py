"""What the robot believes of the depth camera that watches the flap."""

from dataclasses import dataclass

import numpy as np

from maths import se3
from maths.arrays import Array
from maths.pinhole import Intrinsics


@dataclass(frozen=True, kw_only=True)
class DepthCamera:
    """A calibrated depth camera in the world.

    Attributes:
        intrinsics: Of the depth image.
        X_WC: Its pose (4, 4); x right, y down, z forward.
        pose_covariance: (6, 6) of xi in X_WC exp(xi), rotation first, [rad, m].
        depth_scale_std: Standard deviation of all depths' error, as a share of them.
    """

    intrinsics: Intrinsics
    X_WC: Array
    pose_covariance: Array
    depth_scale_std: float = 0.0


def displacement_covariance(camera: DepthCamera, p_WQ: Array) -> Array:
    """Covariance (6, 6) of how the camera's error moves what it sees about a point Q.

    What is seen near Q is displaced by delta + omega x (p - p_WQ); (omega, delta) in W.

    Args:
        camera: With its covariances.
        p_WQ: (3,), [m].
    """
    R = camera.X_WC[:3, :3]
    p_CQ_W = p_WQ - camera.X_WC[:3, 3]
    J = np.zeros((6, 6))
    J[:3, :3] = R
    J[3:, :3] = -se3.skew(p_CQ_W) @ R
    J[3:, 3:] = R
    covariance: Array = J @ camera.pose_covariance @ J.T
    covariance[3:, 3:] += camera.depth_scale_std**2 * np.outer(p_CQ_W, p_CQ_W)
    return covariance


def plane_jacobian(n_W: Array, d: float, p_WQ: Array) -> Array:
    """How (n_W, d) of a plane (4,) change with the displacement (6,) about Q: (4, 6)."""
    J = np.zeros((4, 6))
    J[:3, :3] = -se3.skew(n_W)
    J[3, :3] = np.cross(n_W, p_WQ)
    J[3, 3:] = n_W
    return J
