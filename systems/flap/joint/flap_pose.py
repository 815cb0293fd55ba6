"""A pose of the flap from its plane and its contact, as the joint filters take poses.

The flap's frame B has its origin at the contact and the world's axes when the flap is first
touched. A plane gives two of its rotations, the contact its position. The third rotation follows
from the least one that turns the first normal into this: the axis lies in the flap.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import FingertipContact


class FlapPose(NamedTuple):
    """A measured pose.

    Attributes:
        X_WB: (4, 4).
        covariance: (6, 6), in B, rotation first.
        correlated: Its part (6, 6) that stays for seconds: the contact wanders on the flap, the
            rotation about the normal has the constant error of the first normal, and a normal has
            a correlated error of its own.
    """

    X_WB: Array
    covariance: Array
    correlated: Array


def least_rotation(a: Array, b: Array) -> Array:
    """The rotation (3, 3) by the least angle that turns the unit vector a (3,) into b."""
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return np.asarray(se3.so3_exp(axis * (np.arctan2(sine, a @ b) / sine)))


def flap_pose(
    n0_W: Array,
    n_W: Array,
    n_covariance: Array,
    correlated_n: Array,
    contact: FingertipContact,
    contact_spread: Array,
    twist: float,
) -> FlapPose:
    """The pose that goes with a normal and a contact.

    Args:
        n0_W: The front's normal (3,) when the flap was touched first.
        n_W: That at this tick (3,).
        n_covariance: (3, 3), new at every tick; wide where it was not seen.
        correlated_n: (3, 3), the part of its error that stays for seconds.
        contact: Where the flap is touched.
        contact_spread: Covariance (3, 3) of where on the flap that is, in W, [m^2].
        twist: Standard deviation of the rotation about the normal, [rad].
    """
    R = least_rotation(n0_W, n_W)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, contact.p_WC
    S = se3.skew(n_W)  # dn = omega x n, so that omega = n x dn but for the part about n.
    about_n = twist**2 * np.outer(n_W, n_W)
    stays = S @ correlated_n @ S.T + about_n
    rotation = S @ n_covariance @ S.T + stays
    white = contact.p_WC_white_covariance + contact_spread
    zero = np.zeros((3, 3))
    return FlapPose(
        X,
        np.block([[R.T @ rotation @ R, zero], [zero, R.T @ white @ R]]),
        np.block([[R.T @ stays @ R, zero], [zero, R.T @ contact_spread @ R]]),
    )


def without_position(pose: FlapPose) -> FlapPose:
    """The pose of a flap that is seen but not touched: its position's variance is infinite."""
    covariance, correlated = np.diag(np.full(6, np.inf)), np.zeros((6, 6))
    covariance[:3, :3] = pose.covariance[:3, :3]
    correlated[:3, :3] = pose.correlated[:3, :3]
    return FlapPose(pose.X_WB, covariance, correlated)
