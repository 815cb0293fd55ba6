"""Twists of the fingertip: between its contact, its origin and the world.

A twist is a spatial velocity (6,), rotation first, [rad/s] and [m/s].
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import cross


def from_contact(V_WC_S: Array, p_SC: Array) -> Array:
    """V_WS_S of a fingertip whose point C at `p_SC` (3,) moves with V_WC_S; both in S.

    With -p_SC it is the other way round.
    """
    return np.concatenate([V_WC_S[:3], V_WC_S[3:] - cross(V_WC_S[:3], p_SC)])


def in_world(X_WS: Array, V_WS_S: Array) -> Array:
    """V_WS_W, expressed in the world but still of the origin of S, as Drake's Jacobians have it.

    The adjoint of X_WS gives the velocity of the point of S that is at the world's origin; without
    its lever p x R that of S itself is left.
    """
    R_WS = X_WS[:3, :3]
    return np.concatenate([R_WS @ V_WS_S[:3], R_WS @ V_WS_S[3:]])
