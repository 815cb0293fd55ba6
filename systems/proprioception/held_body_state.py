"""The belief about the held body's pose, and the layout of its error state.

Error state, all but the first in units of their own standard deviation:

    xi  (6,)  pose error, X_WB,true = X_WB exp(xi)
    c   (m,)  constants of the episode: the calibration offset of the encoders
    n   (6,)  rest of the bent hand's pose error, a Gauss-Markov process
    b   (6,)  error of the landmarks, as a pose error in B; only considered: the hand's own slow
              errors look the same, so that it does not correct what is seen
    f   (2,)  share of the hand's turning about the grasping axis, and of its sliding along it, that
              the body follows against what the likeliest grasp says; a constant, only considered
    k   (3,)  turn of the body about the axis per way of its handle, if the grasp lets it; a
              constant, as the body of a hinge turns by one radian per radius; only considered
              unless the likeliest grasp lets it
    s   (6,)  error of the grasping axis and of the point on it; constant while no features are seen

The constants make the displacement's error honest over time: they are the same at every tick, so
they grow with the way that the hand has moved and do not average away. Vision, while it lasts,
measures them too, and so improves what proprioception says in the dark. What the grasp transmits
is learnt by the grasp model alone: states that are only considered make the pose less certain and
are not corrected.
"""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.gaussian import symmetric
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import GraspType, PoseBelief
from crossmodal.systems.proprioception.bent_hand import BentHand
from crossmodal.systems.proprioception.hand_config import HandConfig
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class HeldBodyMotionConfig(Ticked):
    """How the held body is predicted by the hand and corrected by features."""

    # White error of the end-effector above which no reference is taken.
    largest_error: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m")
    hand = HandConfig()
    # Settling of the grip after the reference.
    reference_rotation_error: float = number(0.05, at_least=1e-9, at_most=10.0, unit="rad")
    # The same for the translation.
    reference_translation_error: float = number(6.0e-3, at_least=1e-9, at_most=10.0, unit="m")
    # Time constant with which these errors decay.
    reference_error_time: float = number(2.0, at_least=1e-3, at_most=1e5, unit="s")
    # A turn of the hand counts as this displacement.
    lever: float = number(0.1, at_least=1e-6, at_most=100.0, unit="m/rad")
    # One over the radius of a hinge, 1 sigma.
    hinge_curvature: float = number(3.0, at_least=1e-6, at_most=1000.0, unit="rad/m")
    # Of the velocity, by slip and by the rate of bending.
    velocity_noise: float = number(4.0e-3, at_least=1e-9, at_most=100.0, unit="m/s")
    # Least number of features that tell a pose: three, and one that may contradict.
    minimum_features: int = number(4, at_least=3, at_most=10000)
    # Least share of them that agrees on one pose.
    inlier_share: float = number(0.5, above=0.0, at_most=1.0)
    # Standard deviation of a slip that shows as an outlier.
    jump: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m")
    # Least share of features seen before that shows a slip.
    retained_share: float = number(0.5, above=0.0, at_most=1.0)


class Layout:
    """Where the parts of the error state lie, for m constants; the pose's error is first."""

    def __init__(self, m: int) -> None:
        ends = np.cumsum([6, m, 6, 6, 2, 3, 6]).tolist()
        self.c, self.n, self.b, self.f, self.k, self.s = map(slice, ends, ends[1:])
        self.size = ends[-1]


@dataclass(kw_only=True)
class BodyState(Immutable):
    """Mean and covariance of the body; never written after it is made.

    Attributes:
        hand: The bent hand at the same tick.
        X_WB: (4, 4), with the reference pose X_WB_reference (4, 4).
        x: Mean (n,) of the error state; its first six are zero.
        P: Covariance (n, n).
        V: V_WB_B (6,), with covariance V_covariance (6, 6).
        feature_ids: The features seen last.
        grasp_type: The type under which f and k have their present meaning.
        reference_error: (6, 6), in B, of the grip's settling since the reference; zero once
            features have been seen.
        settled: Share of that error's way that is over, from zero to one.
        reset_count: How many times vision has placed its landmarks anew.
        offset: (6, 6), in B, of the pose's constant error since then; not part of P.
        reference_offset: (6, 6), in B, of how far the grip had settled since the reference when the
            landmarks were placed anew; not part of P.
        shift: How far the body may have moved in the fingers, 1 sigma, part of P, [m].
        reference_delay: From the closing of the hand to the reference, [s].
    """

    hand: BentHand
    X_WB: Array
    X_WB_reference: Array
    x: Array
    P: Array
    grasp_type: GraspType
    reference_error: Array
    V: Array = field(default_factory=lambda: np.zeros(6))
    V_covariance: Array = field(default_factory=lambda: 1e-4 * np.eye(6))
    feature_ids: Ids = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    reset_count: int = 0
    offset: Array = field(default_factory=lambda: np.zeros((6, 6)))
    reference_offset: Array = field(default_factory=lambda: np.zeros((6, 6)))
    shift: float = 0.0
    settled: float = 0.0
    reference_delay: float = 0.0

    @property
    def pose(self) -> PoseBelief:
        return PoseBelief(X=self.X_WB, covariance=self.P[:6, :6] + self.offset)

    @property
    def since_reference(self) -> PoseBelief:
        """The pose; uncertain also by the grip's settling so far, which the body did not follow."""
        settled = self.settled**2 * self.reference_error
        return PoseBelief(X=self.X_WB, covariance=self.pose.covariance + settled)

    def correlated(self, is_seen: bool) -> Array:
        """Covariance (6, 6), in B, of the errors that are correlated over seconds.

        Where features are seen, these are what the pose shares with their landmarks, which lasts
        for as long as they do, and what is left of the grip's settling. Unseen, it is all: the
        hand's errors change slowly, and what was wrong when features were seen last stays so.
        """
        b = Layout(self.hand.bias_jacobian.shape[1]).b
        of_pose = symmetric(self.P[:6, b] @ self.P[b, :6]) if is_seen else self.P[:6, :6]
        return of_pose + (1.0 - self.settled) ** 2 * self.reference_error
