"""What is true about the flap, as the station gives it. Only the evaluation reads it."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class FlapTruth(Immutable):
    """The hinge, the flap and its contact with the fingertip at one instant.

    Attributes:
        theta: Position of the hinge, growing as the flap is turned, [rad].
        k_W: Its axis (3,), a unit vector.
        p_WK: Point on the axis (3,) that is nearest to the contact, else to the fingertip, [m].
        n_W: Normal (3,) of the flap's face that is turned to the camera at first.
        touching: Whether the fingertip touches the flap.
        p_WC: Centre of pressure of the contact (3,), [m]; NaN without one.
        p_SC: The same in the fingertip's frame (3,), [m].
        Sy_W: Outward normal (3,) of the fingertip's pad, the y of S.
        force: Normal force, [N]; 0 without a contact.
        edge_force: Of the flap on the fingertip along the axis, by friction, [N].
    """

    theta: float
    k_W: Array
    p_WK: Array
    n_W: Array
    touching: bool
    p_WC: Array
    p_SC: Array
    Sy_W: Array
    force: float
    edge_force: float


UNKNOWN_FLAP = FlapTruth(
    theta=float("nan"),
    k_W=np.full(3, np.nan),
    p_WK=np.full(3, np.nan),
    n_W=np.full(3, np.nan),
    touching=False,
    p_WC=np.full(3, np.nan),
    p_SC=np.full(3, np.nan),
    Sy_W=np.full(3, np.nan),
    force=0.0,
    edge_force=0.0,
)
