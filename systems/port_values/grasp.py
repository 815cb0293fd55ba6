"""How the hand holds a body."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from crossmodal.maths.arrays import Array


class GraspType(StrEnum):
    PERFECT = "perfect"
    REVOLUTE = "revolute"
    CYLINDRICAL = "cylindrical"
    FAILED = "failed"


@dataclass(kw_only=True)
class GraspBelief:
    """How the bent hand H holds the held body B.

    Attributes:
        probabilities: Of each type, summing to one.
        axis_H: Grasping axis (3,), a unit vector in H where proprioception puts it (a constant
            offset of the hand is part of it).
        p_HA: A point (3,) on the axis, [m].
        line_covariance: (6, 6) of (axis_H, p_HA), [rad, m]; rank 4, across the axis.
        free_motion: (6, 6) projection, in H at Ho, onto the hand's twists that the body does not
            follow (orthogonal at p_HA, where turning about the axis moves nothing); zero for a
            perfect grasp, identity for a failed one.
    """

    probabilities: dict[GraspType, float]
    axis_H: Array
    p_HA: Array
    line_covariance: Array
    free_motion: Array

    @property
    def type(self) -> GraspType:
        """The most probable type."""
        return max(self.probabilities, key=lambda grasp_type: self.probabilities[grasp_type])


@dataclass(frozen=True, kw_only=True)
class HandLoad:
    """What wrist and chambers measure at a tick, its mean over the tick's samples.

    Attributes:
        F_S: Load on the hand without its weight (6,), torque [N m] then force [N], with the
            sensor's bias; NaN where nothing was measured.
        pressures: Of the chambers (chambers,), gauge, [Pa]; NaN likewise.
        variances: (6,) of what is left in F_S of an offset that was taken out of the samples.
    """

    F_S: Array
    pressures: Array
    variances: Array = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True, kw_only=True)
class SlipBelief:
    """What load and pressures say of what the hand has closed around.

    Attributes:
        log_odds: Evidence that it is no longer held as it was, [nat]; zero says nothing.
        shift: How far it may have moved in the fingers since they closed, 1 sigma, [m].
    """

    log_odds: float = 0.0
    shift: float = 0.0


UNKNOWN_LOAD = HandLoad(F_S=np.full(6, np.nan), pressures=np.full(4, np.nan))
NO_SLIP = SlipBelief()
