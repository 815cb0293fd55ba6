"""Point features in the world, and rigid bodies: how they move and where they are expected."""

from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.systems.port_values.motions import MotionBelief, PoseBelief


@dataclass(kw_only=True)
class FeatureBelief:
    """N tracked point features; a feature keeps its id as long as it is tracked.

    Attributes:
        ids: (N,) unique, never used again.
        uv: Pixels (N, 2).
        p_WF: Positions in the world (N, 3), [m].
        covariance: Of the positions (N, 3, 3), [m^2], one frame's noise.
        age: Ticks since its initiation (N,).
    """

    ids: Ids
    uv: Array
    p_WF: Array
    covariance: Array
    age: Ids


def no_features() -> FeatureBelief:
    """The belief that nothing is tracked."""
    return FeatureBelief(
        ids=np.zeros(0, np.int64),
        uv=np.zeros((0, 2)),
        p_WF=np.zeros((0, 3)),
        covariance=np.zeros((0, 3, 3)),
        age=np.zeros(0, np.int64),
    )


@dataclass(kw_only=True)
class ExpectedFeatures(FeatureBelief):
    """Where features are expected, and what they are taken to be a part of.

    Attributes:
        body: Number of the body that each belongs to (N,); `STATIC_BODY` while it rests or
            belongs to none.
        resting: Which (N,) are known to have stood still until now.
    """

    body: Ids
    resting: Mask


def no_expectations() -> ExpectedFeatures:
    """The belief that nothing is expected."""
    return ExpectedFeatures(
        **vars(no_features()), body=np.zeros(0, np.int64), resting=np.zeros(0, bool)
    )


STATIC_BODY = 0  # The environment, which never moves.
HELD_BODY = 1  # The body that the hand holds; vision numbers its own from 2 on.


@dataclass(kw_only=True)
class BodyMotion:
    """A rigid body's motion and the features that move with it.

    Attributes:
        body_id: `STATIC_BODY`, `HELD_BODY` or a number from 2 on.
        motion: Pose X_WB and velocity.
        X_WB_reference: X_WB (4, 4) at the reference, before the body moved.
        feature_ids: (K,) features with a landmark in the body.
        p_BF: Landmarks, the constant positions of these features in the body (K, 3), [m].
        p_BF_covariance: (3K, 3K), [m^2]: landmarks that were placed together are wrong together.
        correlated_covariance: (6, 6), in B, of that part of the pose's error that is correlated
            over seconds: more measurements of the kind do not average it away.
        reference_age: Time since the body was last known to stand at its reference, [s]; NaN
            where that is not known.
        reset_count: How many times the body was lost from sight and got new landmarks where it was
            believed to be; from then on, the pose's error has a part that is constant in B.
        offset_covariance: (6, 6), in B, of that part. Included in the motion's covariance.
        reference_offset_covariance: (6, 6), in B, of the reference's own error since then; not
            included.
        is_seen: Whether it was measured at this tick, by the eye or by the hand that holds it; else
            it is predicted to have gone on.
        assigned_ids: (L,) all features that move with it, those without a landmark too.
    """

    body_id: int
    motion: MotionBelief
    X_WB_reference: Array
    feature_ids: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    p_BF: Array = field(default_factory=lambda: np.zeros((0, 3)))
    p_BF_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    correlated_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    reference_age: float = float("nan")
    reset_count: int = 0
    offset_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    reference_offset_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    is_seen: bool = True
    assigned_ids: Ids = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(kw_only=True)
class HeldBody(BodyMotion):
    """The body that the hand holds, and what vision alone says about it at this tick.

    Attributes:
        seen: X_WB from the features alone, independent of proprioception, with the covariance of
            one frame's noise; None in the dark.
        seen_offset_covariance: (6, 6), in B, of the error that stays as long as the same features
            are used: their landmarks are as wrong at the next tick.
        seen_reference: X_WB (4, 4) where vision knows the body to have stood at rest, for which its
            landmarks are right; where the hand closed, unless vision knew the body before.
        reference_delay: From the closing of the hand to the reference, [s]; the body may have moved
            unnoticed.
    """

    seen: PoseBelief | None = None
    seen_offset_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    seen_reference: Array = field(default_factory=lambda: np.eye(4))
    reference_delay: float = 0.0


@dataclass(kw_only=True)
class BodyMotions:
    """All moving bodies that one system knows; the static environment is left out."""

    bodies: list[BodyMotion] = field(default_factory=list)

    def find(self, body_id: int) -> BodyMotion | None:
        """The body of this number, None where it is not known."""
        return next((body for body in self.bodies if body.body_id == body_id), None)

    def recorded(self) -> "BodyMotions":
        """The bodies without their landmarks' covariances, which take 100 kB each."""
        nothing = np.zeros((0, 0))
        return BodyMotions(bodies=[replace(body, p_BF_covariance=nothing) for body in self.bodies])


@dataclass(kw_only=True)
class BodyPrediction:
    """Where a body is expected at the next tick, by one model that predicts it."""

    body_id: int
    source: str
    pose: PoseBelief


@dataclass(kw_only=True)
class BodyPredictions:
    """Where bodies are expected at the next tick."""

    predictions: list[BodyPrediction] = field(default_factory=list)
