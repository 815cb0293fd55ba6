"""Where a frame is and how it moves, with how sure that is."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array


@dataclass(kw_only=True)
class PoseBelief:
    """An uncertain pose: mean X (4, 4) and covariance (6, 6) in the moving frame."""

    X: Array
    covariance: Array


@dataclass(kw_only=True)
class MotionBelief:
    """An uncertain pose and velocity of a frame F in the world.

    Attributes:
        X: X_WF (4, 4).
        V: V_WF_F (6,), [rad/s, m/s]: X_WF(t + dt) = X_WF(t) exp(V dt).
        covariance: (12, 12) of (pose error in F, velocity error).
    """

    X: Array
    V: Array
    covariance: Array


@dataclass(kw_only=True)
class EndEffectorBelief(MotionBelief):
    """The end-effector's motion, with the part of its pose error that stays for an episode.

    The pose error is white + bias_jacobian @ c, where c ~ N(0, I) is drawn once per episode (the
    offset of the encoders); `covariance` holds the sum of both parts. Whoever uses displacements
    needs them apart: the offset nearly cancels between two ticks, the white part does not.

    Attributes:
        bias_jacobian: (6, m), pose error in E per unit of each constant.
    """

    bias_jacobian: Array

    @property
    def white_covariance(self) -> Array:
        """The covariance (12, 12) without the offset."""
        white = self.covariance.copy()
        white[:6, :6] -= self.bias_jacobian @ self.bias_jacobian.T
        return white


# What a port of this type holds before anyone has written to it.
UNKNOWN_END_EFFECTOR = EndEffectorBelief(
    X=np.eye(4), V=np.zeros(6), covariance=np.eye(12), bias_jacobian=np.zeros((6, 0))
)

# What stands for a pose that does not exist.
NO_POSE = PoseBelief(X=np.full((4, 4), np.nan), covariance=np.full((6, 6), np.nan))


@dataclass(kw_only=True)
class CameraDisplacement(PoseBelief):
    """Where a camera C is in the place S at which it is calibrated to be: X_SC.

    Attributes:
        jumps: How many times it has been knocked out of its place.
        jump_covariance: Of xi in X_SC exp(xi) (6, 6), of that part of its error that is new since
            the last time, as it was known at once.
    """

    jumps: int
    jump_covariance: Array


# A camera that is where it is said to be.
IN_PLACE = CameraDisplacement(
    X=np.eye(4), covariance=np.zeros((6, 6)), jumps=0, jump_covariance=np.zeros((6, 6))
)
