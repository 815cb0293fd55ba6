"""Joints between bodies: type, parameters, configuration, and what it takes to move them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from crossmodal.maths.arrays import Array, unknown


class JointType(StrEnum):
    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"
    SCREW = "screw"
    RIGID = "rigid"
    DISCONNECTED = "disconnected"


HINGE_CLIMB = 5e-3  # A door that climbs less is as good as one, 8 mm in a right angle, [m/rad].
_STEEPEST = 10.0  # Of screws, [m/rad].
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
        configuration: (q, qdot), [m or rad, per s]; q is zero at the reference. That of the body in
            the hand is where vision saw it rest before, or else where the hand closed.
        configuration_covariance: (2, 2).
        pitch_mixture: (K, 3) of by how much a screw moves along its axis: weights, summing to one,
            means [m/rad] and variances [m^2/rad^2] of normal distributions. How steep screws are is
            a matter of scale, so that a pitch that is hardly known is not normal.
        grasp_configuration: q where the hand closed around the child, [m or rad]; zero where that
            is the reference.
    """

    log_evidence: float
    axis_P: Array = unknown(3)
    axis_covariance: Array = unknown(3, 3)
    p_PA: Array = unknown(3)
    p_PA_covariance: Array = unknown(3, 3)
    configuration: Array = unknown(2)
    configuration_covariance: Array = unknown(2, 2)
    pitch_mixture: Array = unknown(1, 3)
    grasp_configuration: float = 0.0

    @property
    def pitch(self) -> float:
        """Its mean, [m/rad]."""
        return float(self.pitch_mixture[:, 0] @ self.pitch_mixture[:, 1])

    @property
    def pitch_variance(self) -> float:
        """[m^2/rad^2]"""
        weight, mean, variance = self.pitch_mixture.T
        return float(weight @ (variance + (mean - self.pitch) ** 2))


@dataclass(frozen=True, kw_only=True)
class JointFit:
    """How well the likeliest type explains what was measured, and what that has taken.

    Attributes:
        reduced_chi_square: Of the measurements off the type's path; NaN for a disconnected body.
        bounds: Inside which that is in 95 % of all cases if the type is right.
        degrees: Of freedom of chi-square.
        outlier_share: Of the measurements.
        noise_scale: Factors on the reported standard deviations of rotation and translation.
        noise_correlation: Of the errors of neighbouring measurements, as they seem; zero where it
            cannot be distinguished from none.
        path_floor: Error that does not average out, as a multiple of the reported deviations, or of
            1.5 mm and 5 mrad, by which real joints deviate, where less is reported.
        wander: Standard deviation of rotations' errors that are smooth in time and not reported,
            per direction, [rad]; zero where there seem to be none.
    """

    reduced_chi_square: float
    bounds: tuple[float, float]
    degrees: int
    outlier_share: float
    noise_scale: tuple[float, float]
    noise_correlation: float
    path_floor: float
    wander: float = 0.0


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
        reference_age: How long ago the child was at the reference, where q is zero, [s]; NaN where
            that is not known.
    """

    parent_id: int
    child_id: int
    probabilities: dict[JointType, float]
    models: dict[JointType, JointModelBelief]
    updates: int
    skipped: Mapping[str, int] = field(default_factory=dict)
    fit: JointFit | None = None
    reference_age: float = math.nan

    @property
    def type(self) -> JointType:
        """The most probable type."""
        return max(self.probabilities, key=lambda joint_type: self.probabilities[joint_type])

    @property
    def model(self) -> JointModelBelief:
        """The belief of the most probable type."""
        return self.models[self.type]

    def hinge_probability(self, climb: float = HINGE_CLIMB) -> float:
        """Probability that the child turns about an axis and climbs next to nothing along it.

        A hinge and a screw of a small pitch share their probability as long as nothing tells them
        apart. Here they count together.

        Args:
            climb: A screw that climbs less is as good as a hinge, [m/rad].
        """
        flat = 0.0
        for weight, mean, variance in self.models[JointType.SCREW].pitch_mixture.tolist():
            if math.isnan(mean):
                continue
            deviation = math.sqrt(2.0 * variance) if variance > 0.0 else 1e-12
            above, below = (climb - mean) / deviation, (climb + mean) / deviation
            flat += 0.5 * weight * (math.erf(above) + math.erf(below))
        return self.probabilities[JointType.REVOLUTE] + self.probabilities[JointType.SCREW] * flat

    def hinge_climb(self, probability: float = 0.9) -> float:
        """What the child climbs at most if it is a hinge with this probability, [m/rad].

        The smallest argument for which `hinge_probability` is so large; infinite if none is.
        """
        low, high = 0.0, _STEEPEST
        if self.hinge_probability(high) < probability:
            return math.inf
        for _ in range(40):
            middle = 0.5 * (low + high)
            if self.hinge_probability(middle) < probability:
                low = middle
            else:
                high = middle
        return high


@dataclass(kw_only=True)
class JointBeliefs:
    """All joints that one system knows."""

    joints: list[JointBelief] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class LimitBelief:
    """One end of a joint's range.

    Attributes:
        probability: That the joint has reached an end stop there.
        position: Where it would be, [m or rad]; NaN where the joint has not rested at its extreme.
        variance: Of that.
        bound: How far the joint has been seen to go: the limit is not before it, [m or rad].
        bound_variance: Of that.
    """

    probability: float
    position: float
    variance: float
    bound: float
    bound_variance: float


@dataclass(frozen=True, kw_only=True)
class DetentBelief:
    """What held the joint more firmly than friction before it gave way.

    Attributes:
        probability: That there was such a detent.
        position: Where, [m or rad]; NaN where the joint has never been seen to start moving.
        variance: Of that.
        force: Beyond friction, to overcome it, [N or N m].
        force_variance: Of that.
    """

    probability: float = 0.0
    position: float = math.nan
    variance: float = math.nan
    force: float = math.nan
    force_variance: float = math.nan


@dataclass(frozen=True, kw_only=True)
class JointMechanicsBelief:
    """What is believed of the joint's forces if it is of one type.

    Positions are in the sense and from the zero of that type's `JointModelBelief.configuration`.

    Attributes:
        friction: (2,) Coulomb friction [N or N m] and viscous coefficient [the same per (m or
            rad)/s]. A zero mean with a wide covariance says that nothing is known.
        friction_covariance: (2, 2).
        noise: Standard deviation of the forces that are not explained, [N or N m].
        samples: At which the joint moved.
        mean_speed: Over those, [m/s or rad/s]; NaN without one.
        lower: End of the range against the axis.
        upper: End of the range along the axis.
        detent: The likeliest.
        force: Generalised force of the hand on the joint at this tick, [N or N m]; NaN where it was
            not measured.
    """

    friction: Array
    friction_covariance: Array
    noise: float
    samples: int
    mean_speed: float
    lower: LimitBelief
    upper: LimitBelief
    detent: DetentBelief
    force: float


@dataclass(frozen=True, kw_only=True)
class JointMechanics:
    """The mechanics of one joint.

    Attributes:
        parent_id: See `JointBelief`.
        child_id: See `JointBelief`.
        models: By type that can move.
    """

    parent_id: int
    child_id: int
    models: dict[JointType, JointMechanicsBelief]


@dataclass(frozen=True, kw_only=True)
class JointMechanicsBeliefs:
    """The joints of the body in the hand."""

    joints: list[JointMechanics] = field(default_factory=list)
