"""What a robot believes of its depth camera."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import StampedImage


@dataclass(frozen=True, kw_only=True)
class DepthCamera:
    """A calibrated depth camera in the world.

    Attributes:
        intrinsics: Of the depth image.
        X_WC: Its pose (4, 4); x right, y down, z forward.
        pose_covariance: (6, 6) of xi in X_WC exp(xi), rotation first, [rad, m]; with what a shift
            of the depth image amounts to (`with_shift`).
        registration_std: Of a shift of the depth image against the colour image, along u and v
            each, [px].
        depth_scale_std: Standard deviation of all depths' error, as a share of them.
        focal_length_std: Likewise of the focal length.
        latency_std: Of by how much later than at its stamp an image shows the world, [s].
    """

    intrinsics: Intrinsics
    X_WC: Array
    pose_covariance: Array
    registration_std: float = 0.0
    depth_scale_std: float = 0.0
    focal_length_std: float = 0.0
    latency_std: float = 0.0


def with_shift(covariance: Array, intrinsics: Intrinsics, registration_std: float) -> Array:
    """Covariance (6, 6) of a depth camera's pose whose image may be shifted.

    A shift of the depth image against the colour image, whose intrinsics are known, is a rotation
    of the depth camera.

    Args:
        covariance: Of the camera's pose (6, 6), rotation first, [rad, m].
        intrinsics: Of the colour image.
        registration_std: Of the shift along u and v each, [px].
    """
    shifted = covariance.copy()
    shifted[0, 0] += (registration_std / intrinsics.focal_y) ** 2
    shifted[1, 1] += (registration_std / intrinsics.focal_x) ** 2
    return shifted


def at_image(camera: DepthCamera, image: StampedImage) -> DepthCamera:
    """The camera where an image says that it was."""
    covariance = with_shift(image.covariance, camera.intrinsics, camera.registration_std)
    return replace(camera, X_WC=image.X_WC, pose_covariance=covariance)


def displacement_covariance(X_WF: Array, covariance: Array, p_WQ: Array) -> Array:
    """Covariance (6, 6) of how a frame's error displaces what is said by it, about a point Q.

    What is near Q is displaced by delta + omega x (p - p_WQ); (omega, delta) in W.

    Args:
        X_WF: The frame (4, 4).
        covariance: (6, 6) of xi in X_WF exp(xi), rotation first, [rad, m].
        p_WQ: (3,), [m].
    """
    R = X_WF[:3, :3]
    J = np.zeros((6, 6))
    J[:3, :3] = R
    J[3:, :3] = -se3.skew(p_WQ - X_WF[:3, 3]) @ R
    J[3:, 3:] = R
    return np.asarray(J @ covariance @ J.T)


def seen_covariance(camera: DepthCamera, p_WQ: Array) -> Array:
    """Covariance (6, 6) of how the camera's error displaces what it sees about a point Q (3,)."""
    covariance = displacement_covariance(camera.X_WC, camera.pose_covariance, p_WQ)
    ray = p_WQ - camera.X_WC[:3, 3]
    covariance[3:, 3:] += camera.depth_scale_std**2 * np.outer(ray, ray)
    return covariance


def plane_jacobian(n_W: Array, d: float, p_WQ: Array) -> Array:
    """How (n_W, d) of a plane (4,) change with the displacement (6,) about Q: (4, 6)."""
    J = np.zeros((4, 6))
    J[:3, :3] = -se3.skew(n_W)
    J[3, :3] = np.cross(n_W, p_WQ)
    J[3, 3:] = n_W
    return J


def focal_tilt(camera: DepthCamera, n_W: Array) -> Array:
    """How a seen normal (3,) changes with the focal length's error, as a share of it: (3,).

    Points move away from the optical axis z with (I - z z^T), so that n changes by its negative.
    """
    z = camera.X_WC[:3, 2]
    return np.asarray((z @ n_W) * (z - n_W * (n_W @ z)))


def tilt_covariance(camera: DepthCamera, n0_W: Array, n_W: Array) -> Array:
    """Covariance (3, 3) of how the focal length's error tilts n (3,) other than n0 (3,)."""
    tilt = camera.focal_length_std * (focal_tilt(camera, n_W) - focal_tilt(camera, n0_W))
    return np.outer(tilt, tilt)


def angle_variance(camera: DepthCamera, k_W: Array, n0_W: Array, n_W: Array, rate: float) -> float:
    """Variance of an angle about k between two seen normals by what all images share, [rad^2].

    The camera's pose turns both normals alike; its focal length tilts them, its latency shows the
    second one as it was.

    Args:
        camera: With its standard deviations.
        k_W: Axis (3,).
        n0_W: Normal (3,) at the angle zero.
        n_W: Normal (3,) now.
        rate: Of the angle, [rad/s].
    """
    tilt = float(np.cross(k_W, n_W) @ focal_tilt(camera, n_W))
    tilt -= float(np.cross(k_W, n0_W) @ focal_tilt(camera, n0_W))
    return (camera.focal_length_std * tilt) ** 2 + (camera.latency_std * rate) ** 2
