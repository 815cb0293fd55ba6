"""What it takes to move a joint, and how far it goes."""

import math
from dataclasses import dataclass, field

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values.joints import JointType


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
class LatchBelief:
    """What held the joint more firmly than friction before it gave way.

    Attributes:
        probability: That there was such a latch.
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
        latch: The likeliest.
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
    latch: LatchBelief
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
