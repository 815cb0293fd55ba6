"""What the body tracker remembers of the bodies that it follows."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies.body_filter import BodyFilter
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory, no_history
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig


@dataclass(kw_only=True)
class RestPositions:
    """Where features were before a body moved: ids (K,), p_WF (K, 3), covariance (K, 3, 3)."""

    ids: Ids
    p_WF: Array
    covariance: Array


@dataclass(kw_only=True)
class TrackedBody(Immutable):
    """One body's filter and recent past; never written after it is made.

    Attributes:
        body_id: `HELD_BODY` or a number from 2 on.
        filter: Belief about pose, velocity and landmarks.
        X_WB_reference: Pose (4, 4) at the reference.
        reference_tick: The last tick at which it is known to have stood there.
        rest: Positions until then of all features that existed, on whatever body.
        path: X_WB over the window (H, 4, 4), newest last.
        support: Number of features that agreed with it at this tick.
        supported: Number of ticks with at least `keep_support` of them.
        unsupported: Ticks since the last of these.
        source: Name of the prediction that fitted best at this tick.
        held_since: Tick at which the hand had closed on the held body; -1 for others.
        reset_count: How many times it was lost and its landmarks were placed anew.
        offset: Covariance (6, 6), in B, of the pose's constant error since then; not part of the
            filter's.
    """

    body_id: int
    filter: BodyFilter
    X_WB_reference: Array
    reference_tick: int
    rest: RestPositions
    path: Array
    support: int = 0
    supported: int = 0
    unsupported: int = 0
    source: str = "reference"
    held_since: int = -1
    reset_count: int = 0
    offset: Array = field(default_factory=lambda: np.zeros((6, 6)))


@dataclass(kw_only=True)
class BodyTrackerState(Immutable):
    """Everything that the body tracker remembers; never written after it is made."""

    tick: int
    next_id: int
    history: FeatureHistory
    bodies: list[TrackedBody] = field(default_factory=list)
    camera_jumps: int = 0


def no_bodies(config: RigidBodyMotionConfig) -> BodyTrackerState:
    window = whole_ticks(config.history.window, config.period)
    return BodyTrackerState(tick=-1, next_id=2, history=no_history(window))
