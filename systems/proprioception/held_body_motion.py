"""The motion of the body that the hand holds, from proprioception alone or corrected by vision."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPort

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.rigid_points import pose_scale
from crossmodal.maths.validation import check
from crossmodal.systems.port_values import (
    HELD_BODY,
    NO_POSE,
    NO_SLIP,
    UNKNOWN_END_EFFECTOR,
    BodyMotion,
    BodyMotions,
    EndEffectorBelief,
    FeatureBelief,
    GraspBelief,
    GraspType,
    HeldBody,
    MotionBelief,
    PoseBelief,
    no_features,
)
from crossmodal.systems.proprioception.bent_hand import bent_hand
from crossmodal.systems.proprioception.feature_registration import GATE, register
from crossmodal.systems.proprioception.grasp_failure import GraspFailureConfig
from crossmodal.systems.proprioception.grasp_filters import if_held
from crossmodal.systems.proprioception.grasp_model import initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.proprioception.hand_config import check_hand
from crossmodal.systems.proprioception.held_body_filter import (
    correct_body,
    predict_body,
    reset_body,
    shift_body,
    start_body,
    with_velocity,
)
from crossmodal.systems.proprioception.held_body_state import BodyState, HeldBodyMotionConfig
from crossmodal.systems.recursive_filter import RecursiveFilter


def is_known(end_effector: EndEffectorBelief, config: HeldBodyMotionConfig) -> bool:
    """Whether the encoders say where the hand is; without them for a while it may be anywhere."""
    largest = pose_scale(config.largest_error)
    return bool(np.all(np.diag(end_effector.white_covariance)[:6] < largest**2))


_FAILURE = GraspFailureConfig()
_CERTAIN = float(np.log(_FAILURE.certain / (1.0 - _FAILURE.certain)))
# Largest log odds that remain of a grasp, with its prior, once its body is hidden, [nat].
_REMEMBERED = _FAILURE.limit + float(np.log(1.0 / _FAILURE.prior - 1.0))


@dataclass(kw_only=True)
class Sighting:
    """What this tick's features say about the body.

    Attributes:
        pose: X_WB from the features alone, with one frame's noise.
        offset_covariance: (6, 6), in B, of what stays as long as the features do.
        body: The body as rigid-body motion describes it, with its features' positions in it.
        ids: Its features (M,) that are seen; one that errs at this tick alone is no other feature.
        rows: Those of its features (K,), by row, that are seen and agree.
    """

    pose: PoseBelief
    offset_covariance: Array
    body: BodyMotion
    ids: Ids
    rows: Ids


def covariance_of(body: BodyMotion, features: Ids) -> Array:
    """Covariance (3K, 3K) of the positions in the body of K of its features, given by row."""
    rows = (3 * features[:, None] + np.arange(3)).ravel()
    return np.asarray(body.p_BF_covariance[np.ix_(rows, rows)])


def sight(
    X_start: Array,
    features: FeatureBelief,
    motions: BodyMotions,
    config: HeldBodyMotionConfig,
) -> Sighting | None:
    """Registers the features that belong to the held body; None if they are too few."""
    body = motions.find(HELD_BODY)
    if body is None:
        return None
    _, rows, seen = np.intersect1d(body.feature_ids, features.ids, return_indices=True)
    if len(rows) < config.minimum_features:
        return None
    X, white, offset, distance = register(
        np.ascontiguousarray(X_start),
        body.p_BF[rows],
        covariance_of(body, rows),
        features.p_WF[seen],
        features.covariance[seen],
    )
    agree = distance <= GATE
    if agree.sum() < max(config.minimum_features, config.inlier_share * len(rows)):
        return None
    return Sighting(
        pose=PoseBelief(X=X, covariance=0.5 * (white + white.T)),
        offset_covariance=0.5 * (offset + offset.T),
        body=body,
        ids=body.feature_ids[rows],
        rows=rows[agree],
    )


@dataclass(kw_only=True)
class HeldBodyState(Immutable):
    """What is in the closed hand.

    Attributes:
        body: None while the hand is open, while nobody knows where it is, and once it has lost what
            it held.
        sighting: What corrected it at this tick, if anything.
        is_doubted: Whether it has more likely been lost than not; then it measures nothing.
        lost: Whether the hand has lost what it held, for certain, since it closed.
        waited: For how long the hand has been closed without a body, [s].
        slip_odds: What load and pressures have said of a slip, [nat].
    """

    body: BodyState | None = None
    sighting: Sighting | None = None
    is_doubted: bool = False
    lost: bool = False
    waited: float = 0.0
    slip_odds: float = 0.0


def loss_odds(grasp: GraspBelief, slip_before: float, slip: float) -> float:
    """Log odds that the hand has lost its body, now that nobody sees that, [nat].

    Args:
        grasp: As it was believed at the last tick.
        slip_before: What load and pressures had said of it then, [nat].
        slip: What they say now, [nat].
    """
    failed = np.clip(grasp.probabilities[GraspType.FAILED], 1e-12, 1.0 - 1e-12)
    return max(float(np.log(failed / (1.0 - failed))) - slip_before, -_REMEMBERED) + slip


def body_motions(state: HeldBodyState) -> BodyMotions:
    """The port value of a state."""
    body, sighting = state.body, state.sighting
    if body is None:
        return BodyMotions()
    covariance = np.zeros((12, 12))
    covariance[:6, :6] = body.pose.covariance
    covariance[6:, 6:] = body.V_covariance
    seen: dict[str, Any] = {}
    if sighting is not None:
        rows, by_vision = sighting.rows, sighting.body
        seen = {
            "feature_ids": by_vision.feature_ids[rows],
            "assigned_ids": by_vision.assigned_ids,
            "p_BF": by_vision.p_BF[rows],
            "p_BF_covariance": covariance_of(by_vision, rows),
            "seen": sighting.pose,
            "seen_offset_covariance": sighting.offset_covariance,
            "seen_reference": by_vision.X_WB_reference,
        }
    return BodyMotions(
        bodies=[
            HeldBody(
                body_id=HELD_BODY,
                motion=MotionBelief(X=body.X_WB, V=body.V, covariance=covariance),
                X_WB_reference=body.X_WB_reference,
                correlated_covariance=body.correlated(is_seen=sighting is not None),
                reset_count=body.reset_count,
                offset_covariance=body.offset,
                reference_offset_covariance=body.reference_offset,
                reference_delay=body.reference_delay,
                is_seen=not state.is_doubted,
                **seen,
            )
        ]
    )


class HeldBodyMotion(RecursiveFilter):
    """Recursive estimate of the pose and velocity of the body that the hand holds.

    Prediction: the bent hand's displacement moves the body as far as the grasp transmits it,
    X_WB(t) = X_WH exp((I - N) log(X_WH^-1 X_WH(t))) X_WH^-1 X_WB, with X_WH = X_WE X_EH at t-1 and
    the grasp's free motion N. Only displacements enter, so a constant offset of the end-effector
    turns the path by its rotation and otherwise cancels. N is that of a grasp that has not failed,
    unless a failure is likelier than not and the body is seen, which then stays where it was.
    Without vision the prediction is the belief. Once the grasp is believed to have failed and the
    body is not seen, where it would be is no measurement any more (`BodyMotion.is_seen`), although
    the prior still says where to look for it; from `GraspFailureConfig.certain` on nothing is held,
    until the hand opens and closes again. With `corrected_by_vision`, the features that rigid-body
    motion has assigned to the body are registered to their positions in it and correct pose and
    constants; whenever there are too few of them (darkness), the prediction goes on from the last
    posterior.

    B has the world's axes and sits at Ho at the reference, the first tick of the interaction at
    which the encoders say where the hand is. The
    covariance, in B, is that of the displacement since then (`held_body_filter`). It is
    correlated over time: the calibration offset and the bending's error are the same at each tick.

    Input ports:
    - `end_effector_estimated`: `EndEffectorBelief` X_WE.
    - `hand_bending_estimated`: `PoseBelief` X_EH.
    - `grasp_latest`: `GraspBelief` of the last tick.
    - `slip_estimated`: `SlipBelief`; may stay unconnected.
    - `interaction_active`: (1,) above 0.5 from the instant at which the hand has closed.
    - `features_estimated`: `FeatureBelief`, positions in W.
    - `body_motions_estimated`: `BodyMotions`, of which the features of `HELD_BODY` are used. It and
      `features_estimated` exist only with `corrected_by_vision` and may stay unconnected.

    Output ports:
    - `body_prior`: `PoseBelief` X_WB before vision, NaN while nothing is held. It depends on the
      state and on the first five inputs only.
    - `body_motions_estimated`: `BodyMotions`, one `HeldBody` or none, posterior of this tick.
      Its features are those that corrected it.
    - `body_motions_latest`: the same of the last tick, from the state alone.

    Frames: W world, E nominal end-effector, H bent end-effector, B the body.

    Source: Martín-Martín and Brock, IROS 2017, sections IV-D and V; consider states after S. F.
    Schmidt, "Application of state-space methods to navigation problems", 1966.
    """

    def __init__(self, config: HeldBodyMotionConfig, corrected_by_vision: bool = False) -> None:
        super().__init__()
        check(config, "HeldBodyMotion")
        check_hand(config.hand, "HeldBodyMotion")
        self._config = config
        nowhere = PoseBelief(X=np.eye(4), covariance=np.eye(6))
        grasp = initial_grasp(GraspModelConfig())
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._bending = self._declare_value_input("hand_bending_estimated", nowhere)
        self._grasp = self._declare_value_input("grasp_latest", grasp)
        self._slip = self._declare_value_input("slip_estimated", NO_SLIP)
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        prior_inputs = [self._end_effector, self._bending, self._grasp, self._slip, self._active]
        self._features: InputPort | None = None
        if corrected_by_vision:
            self._features = self._declare_value_input("features_estimated", no_features())
            self._motions = self._declare_value_input("body_motions_estimated", BodyMotions())
        self._declare_recursion(HeldBodyState(), self._calc_posterior_state, config.period)
        self._prior = self._declare_cache("prior", self._calc_prior, prior_inputs)
        self.DeclareAbstractOutputPort(
            "body_prior", lambda: Value[object](NO_POSE), self._write_prior, {self._prior.ticket()}
        )
        self._declare_estimated("body_motions_estimated", body_motions)
        self._declare_latest("body_motions_latest", body_motions)

    def _calc_prior(self, context: Context, value: AbstractValue) -> None:
        body: BodyState | None = None
        stored = self._stored(context)
        if self._read(self._active, context)[0] > 0.5 and not stored.lost:
            end_effector = self._read(self._end_effector, context)
            bending = self._read(self._bending, context)
            grasp = self._read(self._grasp, context)
            if stored.is_doubted or grasp.probabilities[GraspType.FAILED] < 0.5:
                grasp = if_held(grasp)
            hand = bent_hand(end_effector, bending)
            before = stored.body
            if before is not None:
                body = predict_body(before, hand, grasp, self._config)
            elif is_known(end_effector, self._config):
                body = start_body(hand, grasp, self._config, stored.waited)
        if body is not None:
            slip = self._read_optional(self._slip, context) or NO_SLIP
            body = shift_body(body, slip.shift, self._config)
            Ad = se3.adjoint(se3.inverse(bending.X))
            V_covariance = Ad @ end_effector.covariance[6:, 6:] @ Ad.T
            body = with_velocity(body, Ad @ end_effector.V, V_covariance, grasp, self._config)
        value.set_value(HeldBodyState(body=body))

    def _write_prior(self, context: Context, value: AbstractValue) -> None:
        prior: HeldBodyState = self._prior.Eval(context)
        value.set_value(NO_POSE if prior.body is None else prior.body.since_reference)

    def _calc_posterior_state(self, context: Context, state: Any) -> HeldBodyState:
        body = self._prior.Eval(context).body
        if body is None:
            if self._read(self._active, context)[0] <= 0.5:
                return HeldBodyState()
            return HeldBodyState(lost=state.lost, waited=state.waited + self._config.period)
        body, sighting = self._correct(context, body)
        slip = self._read_optional(self._slip, context) or NO_SLIP
        grasp = self._read(self._grasp, context)
        odds = loss_odds(grasp, state.slip_odds, slip.log_odds) if sighting is None else -np.inf
        if odds > _CERTAIN:
            return HeldBodyState(lost=True)
        return HeldBodyState(
            body=body, sighting=sighting, is_doubted=odds > 0.0, slip_odds=slip.log_odds
        )

    def _correct(self, context: Context, body: BodyState) -> tuple[BodyState, Sighting | None]:
        """The body after this tick's features, and what they say of it, if anything."""
        if self._features is None or not self._features.HasValue(context):
            return body, None
        features = self._read(self._features, context)
        motions = self._read(self._motions, context)
        sighting = sight(body.X_WB, features, motions, self._config)
        if sighting is None:
            return body, None
        offset, resets = sighting.offset_covariance, sighting.body.reset_count
        if resets != body.reset_count:
            return reset_body(body, sighting.pose, sighting.ids, resets), sighting
        corrected = correct_body(body, sighting.pose, offset, sighting.ids, self._config)
        return (body, None) if corrected is None else (corrected, sighting)
