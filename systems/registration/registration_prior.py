"""What the calibrations of a camera and of arms say of their displacements."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import DepthCamera, displacement_covariance
from crossmodal.systems.port_values import displacement_at
from crossmodal.systems.registration.registration_solver import FOCAL, SCALE, Unknowns, distortion
from crossmodal.systems.registration.robot_view import Joints


@dataclass(frozen=True, kw_only=True)
class CalibratedArm:
    """What is known beforehand of an arm.

    Attributes:
        X_WBase: Where its base is believed to be (4, 4).
        base_covariance: (6, 6) of xi in X_WBase exp(xi), rotation first, [rad, m].
        joint_offset_std: Of each joint's zero (n,), [rad].
    """

    X_WBase: Array
    base_covariance: Array
    joint_offset_std: Array


def prior_covariance(
    unknowns: Unknowns,
    p_WQ: Array,
    camera: DepthCamera,
    arms: Mapping[str, CalibratedArm],
) -> Array:
    """(D, D), what the calibrations say of the unknowns."""
    P = np.zeros((unknowns.size, unknowns.size))
    P[:6, :6] = displacement_covariance(camera.X_WC, camera.pose_covariance, p_WQ)
    P[SCALE, SCALE] = camera.depth_scale_std**2
    P[FOCAL, FOCAL] = camera.focal_length_std**2
    for name, part in unknowns.arms.items():
        arm, base = arms[name], slice(part.start, part.start + 6)
        P[base, base] = displacement_covariance(arm.X_WBase, arm.base_covariance, p_WQ)
        zeros = np.arange(base.stop, part.stop)
        P[zeros, zeros] = arm.joint_offset_std**2
    # A calibration that is specified as perfect still gets a variance, far below what is measured.
    return P + 1e-12 * np.eye(unknowns.size)


def readout(unknowns: Unknowns, p_WQ: Array, X_WC: Array, joints: Mapping[str, Joints]) -> Array:
    """(6 K, D): displacements near Q, of what the camera sees and of the end-effectors' bodies."""
    J = np.zeros((6 * (1 + len(unknowns.arms)), unknowns.size))
    J[:6, :6] = np.eye(6)
    J[3:6, SCALE : FOCAL + 1] = distortion(X_WC, p_WQ)
    for k, (name, part) in enumerate(unknowns.arms.items(), start=1):
        rows = slice(6 * k, 6 * k + 6)
        J[rows, part.start : part.start + 6] = np.eye(6)
        at_E = joints[name].jacobian
        J[rows, part.start + 6 : part.stop] = at_E
        J[rows.start + 3 : rows.stop, part.start + 6 : part.stop] = (
            displacement_at(p_WQ, joints[name].p_WE) @ at_E
        )
    return J
