"""Joints between bodies: type, parameters and configuration."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from crossmodal.maths.arrays import Array, unknown


class JointType(StrEnum):
    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"
    SCREW = "screw"
    RIGID = "rigid"
    DISCONNECTED = "disconnected"


MOVING_TYPES = (JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW)


@dataclass(kw_only=True)
class JointModelBelief:
    """One joint type's belief about how a child body moves relative to its parent P.

    Fields that a type lacks are NaN (a rigid joint has no axis, a prismatic one no position).

    Attributes:
        log_evidence: Log likelihood of the recent measurements under this type.
        axis_P: Unit axis (3,) in the parent's frame.
        axis_covariance: (3, 3), rank 2, of the unit axis, [rad^2].
        p_PA: The point (3,) of a revolute or screw axis nearest to the child at the reference, [m].
        p_PA_covariance: (3, 3), [m^2].
        configuration: (q, qdot), [m or rad, per s]; q is zero at the reference.
        configuration_covariance: (2, 2).
        pitch: By how much a screw moves along its axis, [m/rad].
        pitch_variance: [m^2/rad^2].
    """

    log_evidence: float
    axis_P: Array = unknown(3)
    axis_covariance: Array = unknown(3, 3)
    p_PA: Array = unknown(3)
    p_PA_covariance: Array = unknown(3, 3)
    configuration: Array = unknown(2)
    configuration_covariance: Array = unknown(2, 2)
    pitch: float = np.nan
    pitch_variance: float = np.nan


@dataclass(frozen=True, kw_only=True)
class JointFit:
    """How well the likeliest type explains what was measured, and what that has taken.

    Attributes:
        reduced_chi_square: Of the measurements off the type's path; NaN for a disconnected body.
        bounds: Inside which that is in 95 % of all cases if the type is right.
        degrees: Of freedom of chi-square.
        outlier_share: Of the measurements.
        noise_scale: Factors on the claimed standard deviations of rotation and translation.
        noise_correlation: Of the errors of neighbouring measurements, as they seem; zero where it
            is not told from none.
        path_floor: Error that does not average out, as a multiple of the claimed deviations, or of
            1.5 mm and 5 mrad, by which real joints stray, where less is claimed.
    """

    reduced_chi_square: float
    bounds: tuple[float, float]
    degrees: int
    outlier_share: float
    noise_scale: tuple[float, float]
    noise_correlation: float
    path_floor: float


@dataclass(kw_only=True)
class JointBelief:
    """The belief about the joint between two bodies.

    Attributes:
        parent_id: The reference body; `STATIC_BODY` has the world's frame.
        child_id: The body that moves relative to it.
        probabilities: Of each type, summing to one.
        models: Each type's parameters and configuration.
        updates: Measurements seen.
        skipped: How many others were not used, by reason.
        fit: Of the most probable type; None where nobody has looked.
    """

    parent_id: int
    child_id: int
    probabilities: dict[JointType, float]
    models: dict[JointType, JointModelBelief]
    updates: int
    skipped: Mapping[str, int] = field(default_factory=dict)
    fit: JointFit | None = None

    @property
    def type(self) -> JointType:
        """The most probable type."""
        return max(self.probabilities, key=lambda joint_type: self.probabilities[joint_type])

    @property
    def model(self) -> JointModelBelief:
        """The belief of the most probable type."""
        return self.models[self.type]


@dataclass(kw_only=True)
class JointBeliefs:
    """All joints that one system knows."""

    joints: list[JointBelief] = field(default_factory=list)
