"""What a tactile fingertip feels."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, unknown


@dataclass(frozen=True, kw_only=True)
class TactileContact:
    """A contact on a tactile fingertip, in its frame S.

    The origin of S is the centre of the fingertip's surface of revolution, y points out of its pad,
    z along the finger.

    Attributes:
        touching: Whether there is a contact; without one all else is NaN.
        p_SC: Where it is on the surface (3,), the force-weighted mean of the taxels, [m].
        covariance: Of p_SC (3, 3), [m^2].
        n_S: Mean outward normal of the pressed surface (3,), a unit vector.
        f_S: Force of the finger on what it touches (3,), the sum of the taxels' normal forces, [N].
        edge_angle: Angle of a contact edge about y, from z; NaN where the contact has none, [rad].
    """

    touching: bool = False
    p_SC: Array = unknown(3)
    covariance: Array = unknown(3, 3)
    n_S: Array = unknown(3)
    f_S: Array = unknown(3)
    edge_angle: float = float("nan")

    @property
    def force(self) -> float:
        """Magnitude of `f_S`, [N]; 0 without a contact."""
        return float(np.linalg.norm(self.f_S)) if self.touching else 0.0


NO_CONTACT = TactileContact()


@dataclass(frozen=True, kw_only=True)
class FingertipContact:
    """Where the fingertip is, what it feels, and where that is in the world.

    A position's error has a part that is new at every tick and a part that stays for the episode,
    as the arm's base is where it is: displacements are as sure as the first alone.

    Attributes:
        X_WS: Pose of the fingertip (4, 4).
        covariance: (6, 6) of xi in X_WS exp(xi), rotation first, [rad, m].
        white_covariance: Its part that is new at every tick.
        contact: What is felt, in S.
        p_WC: Where that is (3,), [m]; NaN without a contact, as all below.
        p_WC_covariance: (3, 3), [m^2].
        p_WC_white_covariance: Its part that is new at every tick.
        v_WC: Velocity of the fingertip's own point there (3,), mean of the last tick, [m/s].
        v_WC_covariance: (3, 3), [m^2/s^2].
    """

    X_WS: Array = unknown(4, 4)
    covariance: Array = unknown(6, 6)
    white_covariance: Array = unknown(6, 6)
    contact: TactileContact = NO_CONTACT
    p_WC: Array = unknown(3)
    p_WC_covariance: Array = unknown(3, 3)
    p_WC_white_covariance: Array = unknown(3, 3)
    v_WC: Array = unknown(3)
    v_WC_covariance: Array = unknown(3, 3)


# What a port of this type holds before anyone has written to it.
UNKNOWN_FINGERTIP = FingertipContact()
