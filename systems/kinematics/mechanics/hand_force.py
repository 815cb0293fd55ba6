"""The hand's force on the body that it holds, and how a screw is seen from the hand."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.kinematics.joint_screws import bracket


@dataclass(frozen=True, kw_only=True)
class HandForce(Immutable):
    """What the hand does to the body that it holds.

    Attributes:
        F_P: Spatial force (6,) on the body at Po, torque [N m] first, expressed in P.
        X_PE: Where the hand is (4, 4).
        pose_jacobian: (6, m) constant error of X_PE, in E, per unit of what it comes from.
        zero_covariance: (6, 6) of the constant error of F_P.
        down_P: Unit vector (3,) of gravity in P.
    """

    F_P: Array
    X_PE: Array
    pose_jacobian: Array = field(default_factory=lambda: np.zeros((6, 0)))
    zero_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    down_P: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))


def hand_screw_covariance(S: Array, hand: HandForce) -> Array:
    """How uncertain a screw (6,) is as the hand sees it, which may be elsewhere: (6, 6), in P.

    With X_PE exp(xi) in place of X_PE, S · F_P is that of the twist S + Ad(X_PE) [S_E] xi.
    """
    to_P = se3.adjoint(hand.X_PE)
    S_E = se3.adjoint(se3.inverse(hand.X_PE)) @ S
    B = to_P @ bracket(S_E) @ hand.pose_jacobian
    return np.asarray(B @ B.T)
