"""The flap of an articulated tool: where it is seen, how it is hinged and how far it is turned."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array, unknown


@dataclass(frozen=True, kw_only=True)
class FlapPlane:
    """The flap's surface as one image shows it: n · x = d.

    Attributes:
        seen: Whether it was; else all but `why` is NaN.
        why: Why it was not seen, in words; empty if it was.
        n_W: Unit normal (3,) of the face that is seen, towards the camera.
        d: Distance from the world's origin along the normal, [m].
        covariance: (4, 4) of (n_W, d), of one image's noise; rank 3, since the normal is of unit
            length.
        common_covariance: (4, 4) likewise, of the camera's calibration; it comes on top and is the
            same error in all images.
        p_WF: Centre of the points of the flap (3,), [m].
        points: How many there are.
        edge_W: Direction (3,) of the flap's free edge, a unit vector along z of the fingertip; NaN
            where it is not seen, and once the flap was touched.
        p_WG: Point on that edge (3,), the middle of what is seen of it, [m].
    """

    seen: bool = False
    n_W: Array = unknown(3)
    d: float = np.nan
    covariance: Array = unknown(4, 4)
    p_WF: Array = unknown(3)
    points: int = 0
    why: str = ""
    common_covariance: Array = unknown(4, 4)
    edge_W: Array = unknown(3)
    p_WG: Array = unknown(3)


@dataclass(frozen=True, kw_only=True)
class HingeBelief:
    """The axis about which the flap turns.

    Attributes:
        known: Whether anything is believed of it; else all is NaN.
        k_W: Direction (3,), a unit vector; the flap is turned in the positive sense.
        p_WK: Point on the axis (3,), the nearest to the contact, [m].
        covariance: (6, 6) of (k_W, p_WK), [rad, m]; rank 4, across the axis.
        p_WQ: About which the displacements are (3,), [m].
        displacements: By how much the calibrations displace what the finger says and then what
            the holder says, (omega, delta) each, (12,): measured minus true, [rad, m].
        displacement_covariance: (18, 12) of (k_W, p_WK, displacements) with the displacements: an
            axis that is known by touch errs as touch does.
    """

    known: bool = False
    k_W: Array = unknown(3)
    p_WK: Array = unknown(3)
    covariance: Array = unknown(6, 6)
    p_WQ: Array = field(default_factory=lambda: np.zeros(3))
    displacements: Array = field(default_factory=lambda: np.zeros(12))
    displacement_covariance: Array = field(default_factory=lambda: np.zeros((18, 12)))

    @property
    def joint_covariance(self) -> Array:
        """(18, 18) of (k_W, p_WK, displacements)."""
        C = self.displacement_covariance
        return np.block([[self.covariance, C[:6]], [C[:6].T, C[6:]]])


@dataclass(frozen=True, kw_only=True)
class FlapAngleBelief:
    """How far the flap is turned.

    Attributes:
        known: Whether anything is believed of it; else all is NaN.
        theta: Angle from where the flap was seen before it was touched, or else from where it was
            touched first, [rad].
        variance: Of theta, [rad^2].
        rate: Its rate by the motion of the contact, [rad/s].
        n_W: Unit normal (3,) of the flap that goes with theta: of the face that was seen first.
        n_covariance: (3, 3), rank 2.
        measured: Whether the camera corrected it at this tick.
    """

    known: bool = False
    theta: float = np.nan
    variance: float = np.nan
    rate: float = np.nan
    n_W: Array = unknown(3)
    n_covariance: Array = unknown(3, 3)
    measured: bool = False


@dataclass(frozen=True, kw_only=True)
class ToolBelief:
    """The kinematics of the held tool, as a link of the arm that holds it.

    Frames: E end-effector of that arm, K at the hinge (z along k, x towards the contact when theta
    is 0), T at the contact on the flap.

    Attributes:
        hinge: In the world.
        angle: Of the flap.
        L1_W: From E's origin to K's (3,), [m].
        L2_W: From the contact to K's origin (3,), [m].
        L1_covariance: (3, 3), [m^2].
        L2_covariance: (3, 3), [m^2].
        X_EK: (4, 4).
        X_KT: (4, 4), turned by theta.
    """

    hinge: HingeBelief
    angle: FlapAngleBelief
    L1_W: Array = unknown(3)
    L2_W: Array = unknown(3)
    L1_covariance: Array = unknown(3, 3)
    L2_covariance: Array = unknown(3, 3)
    X_EK: Array = unknown(4, 4)
    X_KT: Array = unknown(4, 4)


def unseen(why: str) -> FlapPlane:
    """What stands for a plane that was not seen."""
    return FlapPlane(why=why)


UNKNOWN_HINGE = HingeBelief(
    p_WQ=np.full(3, np.nan),
    displacements=np.full(12, np.nan),
    displacement_covariance=np.full((18, 12), np.nan),
)
UNKNOWN_ANGLE = FlapAngleBelief()
UNKNOWN_TOOL = ToolBelief(hinge=UNKNOWN_HINGE, angle=UNKNOWN_ANGLE)
