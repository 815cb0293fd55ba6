"""The values that flow between perception systems, one small class per kind of thing.

Frames: W world (the robot's base is calibrated in it), C camera (x right, y down, z forward),
E nominal end-effector, H bent end-effector, S wrist sensor, B a moving body, P a joint's parent.

Poses are (4, 4) matrices. An uncertain pose is X = X_mean exp(xi), xi ~ N(0, covariance): the error
is expressed in the moving frame, rotation [rad] before translation [m]. A body's frame B has the
world's axes and sits near the body at the reference, the instant before it first moved; its
covariance is that of the displacement since then.

Port values are read-only: what `Eval` returns is shared by all readers.
"""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from maths.arrays import Array, Ids

STATIC_BODY = 0  # The environment, which never moves.
INTERACTED_BODY = 1  # The body the hand holds; vision numbers the bodies that it finds from 2 on.


class JointType(StrEnum):
    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"
    RIGID = "rigid"
    DISCONNECTED = "disconnected"


class GraspType(StrEnum):
    PERFECT = "perfect"
    REVOLUTE = "revolute"
    CYLINDRICAL = "cylindrical"
    FAILED = "failed"


@dataclass(kw_only=True)
class SampleWindow:
    """The samples of one sensor since the last tick.

    Attributes:
        times: Stamps (K,), increasing, [s].
        values: Samples (K, n), in the sensor's unit.
    """

    times: Array
    values: Array


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

    The pose error is white + offset_loading @ c, where c ~ N(0, I) is drawn once per episode (the
    offset of the encoders); `covariance` holds the sum of both parts. Whoever uses displacements
    needs them apart: the offset nearly cancels between two ticks, the white part does not.

    Attributes:
        offset_loading: (6, m), pose error in E per unit of each constant.
    """

    offset_loading: Array

    @property
    def white_covariance(self) -> Array:
        """The covariance (12, 12) without the offset."""
        white = self.covariance.copy()
        white[:6, :6] -= self.offset_loading @ self.offset_loading.T
        return white


# What a port of this type holds before anyone has written to it.
UNKNOWN_END_EFFECTOR = EndEffectorBelief(
    X=np.eye(4), V=np.zeros(6), covariance=np.eye(12), offset_loading=np.zeros((6, 0))
)


@dataclass(kw_only=True)
class FeatureBelief:
    """N tracked point features; a feature keeps its id as long as it is tracked.

    Attributes:
        ids: (N,) unique, never used again.
        uv: Pixels (N, 2).
        p_WF: Positions in the world (N, 3), [m].
        covariance: Of the positions (N, 3, 3), [m^2], one frame's noise.
        age: Ticks since birth (N,).
    """

    ids: Ids
    uv: Array
    p_WF: Array
    covariance: Array
    age: Ids


@dataclass(kw_only=True)
class BodyMotion:
    """A rigid body's motion and the features that move with it.

    Attributes:
        body_id: `STATIC_BODY`, `INTERACTED_BODY` or a number from 2 on.
        motion: Pose X_WB and velocity.
        X_WB_reference: X_WB (4, 4) at the reference, before the body moved.
        feature_ids: (K,) features assigned to the body.
        p_BF: Their constant positions in the body (K, 3), [m].
        p_BF_covariance: (3K, 3K), [m^2]: features placed in the body together are wrong together.
        lasting_covariance: (6, 6), in B, of that part of the pose's error that stays for seconds:
            more measurements of the kind do not average it away.
        reference_age: How long ago the body was last known to stand at its reference, [s]; NaN
            where that is not known.
        anchored: How many times the body was lost from sight and its new features were placed where
            it was believed to be; the pose's error then got a part that is constant in B.
        offset_covariance: (6, 6), in B, of that part; included in the motion's covariance.
    """

    body_id: int
    motion: MotionBelief
    X_WB_reference: Array
    feature_ids: Ids
    p_BF: Array
    p_BF_covariance: Array
    lasting_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    reference_age: float = float("nan")
    anchored: int = 0
    offset_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))


@dataclass(kw_only=True)
class InteractedBody(BodyMotion):
    """The body in the hand, and what vision alone says about it at this tick.

    Attributes:
        seen: X_WB from the features alone, independent of proprioception, with the covariance of
            one frame's noise; None in the dark.
        seen_offset_covariance: (6, 6), in B, of the error that stays as long as the same features
            are used: their positions in the body are as wrong at the next tick.
    """

    seen: PoseBelief | None
    seen_offset_covariance: Array


@dataclass(kw_only=True)
class BodyMotions:
    """All moving bodies that one system knows; the static environment is left out."""

    bodies: list[BodyMotion] = field(default_factory=list)

    def find(self, body_id: int) -> BodyMotion | None:
        """The body of this number, None where it is not known."""
        return next((body for body in self.bodies if body.body_id == body_id), None)


@dataclass(kw_only=True)
class BodyPrediction:
    """Where a body is expected at the next tick, by one model that predicts it."""

    body_id: int
    source: str
    pose: PoseBelief


@dataclass(kw_only=True)
class BodyPredictions:
    predictions: list[BodyPrediction] = field(default_factory=list)


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
    """

    parent_id: int
    child_id: int
    probabilities: dict[JointType, float]
    models: dict[JointType, JointModelBelief]
    updates: int

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
    joints: list[JointBelief] = field(default_factory=list)


@dataclass(kw_only=True)
class GraspBelief:
    """How the bent hand H holds the interacted body B.

    Attributes:
        probabilities: Of each type, summing to one.
        X_HB: Mean relative pose (4, 4) now.
        covariance: Its (6, 6), in B; most of it is the hand's constant offset.
        axis_H: Grasping axis (3,), a unit vector in H where proprioception puts it (a constant
            offset of the hand is part of it).
        p_HA: A point (3,) on the axis, [m].
        line_covariance: (6, 6) of (axis_H, p_HA), [rad, m]; rank 4, across the axis.
        free_motion: (6, 6) projection, in H at Ho, onto the hand's twists that the body does not
            follow (orthogonal at p_HA, where turning about the axis moves nothing); zero for a
            perfect grasp, identity for a failed one.
    """

    probabilities: dict[GraspType, float]
    X_HB: Array
    covariance: Array
    axis_H: Array
    p_HA: Array
    line_covariance: Array
    free_motion: Array

    @property
    def type(self) -> GraspType:
        """The most probable type."""
        return max(self.probabilities, key=lambda grasp_type: self.probabilities[grasp_type])
