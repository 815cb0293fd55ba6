"""Joints between bodies: type, parameters and configuration."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from maths.arrays import Array


class JointType(StrEnum):
    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"
    RIGID = "rigid"
    DISCONNECTED = "disconnected"


@dataclass(kw_only=True)
class JointModelBelief:
    """One joint type's belief about how a child body moves relative to its parent P.

    Fields that a type lacks are NaN (a rigid joint has no axis, a prismatic one no position).

    Attributes:
        log_evidence: Log likelihood of the recent measurements under this type.
        axis_P: Unit axis (3,) in the parent's frame.
        axis_covariance: (3, 3), rank 2, of the unit axis, [rad^2].
        p_PA: The point (3,) of a revolute axis nearest to the child at the reference, [m].
        p_PA_covariance: (3, 3), [m^2].
        configuration: (q, qdot), [m or rad, per s]; q is zero at the reference.
        configuration_covariance: (2, 2).
    """

    log_evidence: float
    axis_P: Array
    axis_covariance: Array
    p_PA: Array
    p_PA_covariance: Array
    configuration: Array
    configuration_covariance: Array


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
    """

    parent_id: int
    child_id: int
    probabilities: dict[JointType, float]
    models: dict[JointType, JointModelBelief]
    updates: int
    skipped: Mapping[str, int] = field(default_factory=dict)

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
