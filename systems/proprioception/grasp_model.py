"""How the bent hand holds the held body: four types side by side, the likeliest wins."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import (
    HELD_BODY,
    NO_SLIP,
    UNKNOWN_END_EFFECTOR,
    BodyMotions,
    GraspBelief,
    GraspType,
    HeldBody,
    PoseBelief,
    SlipBelief,
)
from crossmodal.systems.proprioception.bent_hand import BentHand, bent_hand
from crossmodal.systems.proprioception.grasp_failure import GraspFailure, compare, unseen
from crossmodal.systems.proprioception.grasp_filters import (
    HELD_TYPES,
    GraspFilter,
    correct_filter,
    follow,
    free_projection,
    plausibility,
    predict_filter,
    start_filter,
)
from crossmodal.systems.proprioception.grasp_model_config import (
    GraspModelConfig,
    check_grasp_model,
    prior_probabilities,
)
from crossmodal.systems.recursive_filter import RecursiveFilter

TYPES = (*HELD_TYPES, GraspType.FAILED)


def weigh(
    evidence: Array, failure: GraspFailure, slip: SlipBelief, config: GraspModelConfig
) -> Array:
    """Probabilities of the types (4,) from the log evidence (3,) of those that hold.

    A handle that turns in soft fingers may lodge between them at any time, unseen in the dark: a
    grasp that was loose has become firm with probability `lodging`.
    """
    score = np.log(prior_probabilities(config)[:-1]) + evidence
    weights = np.exp(score - score.max())
    held = (1.0 - config.lodging) * weights / weights.sum()
    held[HELD_TYPES.index(GraspType.PERFECT)] += config.lodging
    return with_failed(held, failure, slip, config)


def with_failed(
    held: Array, failure: GraspFailure, slip: SlipBelief, config: GraspModelConfig
) -> Array:
    """Probabilities of the types (4,) from those of the held types (3,), if it holds."""
    failed = failure.probability(config.failure, slip.log_odds)
    return np.append((1.0 - failed) * held / held.sum(), failed)


def reweigh(
    belief: GraspBelief, failure: GraspFailure, slip: SlipBelief, config: GraspModelConfig
) -> Array:
    """Probabilities of the types (4,) at a tick at which vision says nothing."""
    held = np.array([belief.probabilities[kind] for kind in HELD_TYPES])
    return with_failed(held, unseen(failure, config.failure), slip, config)


@dataclass(kw_only=True)
class GraspState(Immutable):
    """The filters while something is held; never written after it is made.

    Attributes:
        belief: The port value.
        filters: One per held type; empty while nothing is held.
        evidence: Log evidence (3,) that fades, in the order of `HELD_TYPES`.
        hand: The bent hand at the last tick.
        failure: Whether the body still goes where the hand goes.
    """

    belief: GraspBelief
    filters: list[GraspFilter]
    evidence: Array
    hand: BentHand | None
    failure: GraspFailure


def make_belief(
    probabilities: Array, filters: list[GraspFilter], config: GraspModelConfig
) -> GraspBelief:
    """The port value."""
    best = TYPES[int(np.argmax(probabilities))]
    loose = [f for f in filters if f.type != GraspType.PERFECT]
    loose = loose or [start_filter(GraspType.REVOLUTE, np.eye(4), np.zeros((6, 0)), config)]
    line = next((f for f in loose if f.type == best), loose[0])
    return GraspBelief(
        probabilities=dict(zip(TYPES, map(float, probabilities), strict=True)),
        axis_H=line.axis,
        p_HA=line.point,
        line_covariance=line.line_covariance,
        free_motion=free_projection(best, line.axis, line.point),
    )


def initial_grasp(config: GraspModelConfig) -> GraspBelief:
    """What is believed before anything is held: the prior."""
    return make_belief(prior_probabilities(config), [], config)


def initial_state(config: GraspModelConfig) -> GraspState:
    nowhere = PoseBelief(X=np.eye(4), covariance=np.eye(6))
    return GraspState(
        belief=initial_grasp(config),
        filters=[],
        evidence=np.zeros(3),
        hand=None,
        failure=GraspFailure(X_WH=np.eye(4), body=nowhere),
    )


def start_state(hand: BentHand, body: HeldBody, config: GraspModelConfig) -> GraspState:
    """The filters at the reference, where X_HB is known."""
    z_0 = se3.inverse(hand.X_WH) @ body.motion.X
    filters = [start_filter(kind, z_0, hand.bias_jacobian, config) for kind in HELD_TYPES]
    at_reference = PoseBelief(X=body.motion.X, covariance=body.motion.covariance[:6, :6])
    return GraspState(
        belief=make_belief(prior_probabilities(config), filters, config),
        filters=filters,
        evidence=np.zeros(3),
        hand=hand,
        failure=GraspFailure(X_WH=hand.X_WH, body=at_reference),
    )


def doubt(state: GraspState, slip: SlipBelief, config: GraspModelConfig) -> GraspState:
    """A tick at which nobody knows where the body is: one that is lost for certain stays so."""
    if state.belief.probabilities[GraspType.FAILED] >= config.failure.certain:
        return state
    probabilities = reweigh(state.belief, state.failure, slip, config)
    best, line = TYPES[int(np.argmax(probabilities))], state.belief
    belief = replace(
        line,
        probabilities=dict(zip(TYPES, map(float, probabilities), strict=True)),
        free_motion=free_projection(best, line.axis_H, line.p_HA),
    )
    return replace(state, belief=belief)


def reaffirm(
    state: GraspState, hand: BentHand, body: HeldBody, slip: SlipBelief, config: GraspModelConfig
) -> GraspState:
    """A tick without vision: X_HB follows from the grasp, so that it cannot confirm it."""
    z = se3.inverse(hand.X_WH) @ body.motion.X
    filters = [follow(f, z, hand, hand.noise_square_root) for f in state.filters]
    probabilities = reweigh(state.belief, state.failure, slip, config)
    belief = make_belief(probabilities, filters, config)
    return replace(state, belief=belief, filters=filters, hand=hand)


def refresh(
    candidate: GraspFilter, z: Array, hand: BentHand, config: GraspModelConfig
) -> GraspFilter:
    """A filter that has explained nothing for long starts from where the body is now."""
    if candidate.rejection_count * config.period < config.patience:
        return candidate
    return start_filter(candidate.type, z, hand.bias_jacobian, config)


def learn(
    state: GraspState,
    hand: BentHand,
    seen: PoseBelief,
    offset_covariance: Array,
    slip: SlipBelief,
    config: GraspModelConfig,
) -> GraspState:
    """A tick at which vision shows the body: corrects every filter and weighs the types."""
    z = se3.inverse(hand.X_WH) @ seen.X
    Ad = se3.adjoint(z)
    R = Ad @ seen.covariance @ Ad.T
    noise_square_root: Any = np.linalg.cholesky(
        hand.noise_square_root @ hand.noise_square_root.T + Ad @ offset_covariance @ Ad.T
    )
    results = [correct_filter(f, z, R, hand, noise_square_root, config) for f in state.filters]
    likelihoods = np.array([likelihood for _, likelihood in results])
    likelihoods = np.maximum(likelihoods - likelihoods.max(), -config.loss_limit)
    evidence = np.exp(-config.period / config.memory) * state.evidence + likelihoods
    usual = np.array([plausibility(f, config) for f, _ in results])
    failure = compare(state.failure, hand.X_WH, seen, config.hand.grasping_axis[1], config.failure)
    probabilities = weigh(evidence + usual, failure, slip, config)
    filters = [refresh(f, z, hand, config) for f, _ in results]
    return GraspState(
        belief=make_belief(probabilities, filters, config),
        filters=filters,
        evidence=evidence - evidence.max(),
        hand=hand,
        failure=failure,
    )


class GraspModel(RecursiveFilter):
    """Recursive estimate of the kinematics between the bent hand and the body it holds.

    Four types: perfect (no relative motion), revolute (turning about the grasping axis),
    cylindrical (turning about it and sliding along it) and failed (the body stays where it was,
    loosely). Axis and point start from the hand's morphology and are constants in H. Measurement:
    z = X_WH^-1 X_WB. The types are weighed by the log likelihood of their innovations, under the
    real innovation covariance, with a memory of `memory` seconds. A loose grasp is never beyond
    doubt, for it may have become a firm one (`lodging`).

    Only what vision alone says about the body (`HeldBody.seen`) is independent of the grasp.
    In the proprioception-only wiring, and in the dark, the body's pose is computed through the
    grasp: then the relative pose is followed and the prior reaffirmed, without new confidence.

    Input ports:
    - `end_effector_estimated`: `EndEffectorBelief` X_WE.
    - `hand_bending_estimated`: `PoseBelief` X_EH.
    - `body_motions_estimated`: `BodyMotions` with the one `HeldBody`, of
      `HeldBodyMotion`; unconnected, nothing is learnt of the types that hold.
    - `slip_estimated`: `SlipBelief`; may stay unconnected.
    - `interaction_active`: (1,) above 0.5 from the instant at which the hand has closed.

    Output ports:
    - `grasp_estimated`: `GraspBelief`, posterior of this tick.
    - `grasp_latest`: `GraspBelief`, posterior of the last tick, from the state alone.

    Frames: W world, E nominal end-effector, H bent end-effector, A on the grasping axis, B body.

    Source: Martín-Martín and Brock, IROS 2017, section IV-C.
    """

    def __init__(self, config: GraspModelConfig) -> None:
        super().__init__()
        check_grasp_model(config)
        self._config = config
        nowhere = PoseBelief(X=np.eye(4), covariance=np.eye(6))
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._bending = self._declare_value_input("hand_bending_estimated", nowhere)
        self._bodies = self._declare_value_input("body_motions_estimated", BodyMotions())
        self._slip = self._declare_value_input("slip_estimated", NO_SLIP)
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._nothing_held = initial_state(config)
        self._declare_recursion(self._nothing_held, self._calc_grasp, config.period)
        self._declare_estimated("grasp_estimated", lambda state: state.belief)
        self._declare_latest("grasp_latest", lambda state: state.belief)

    def _calc_grasp(self, context: Context, state: Any) -> GraspState:
        if self._read(self._active, context)[0] <= 0.5:
            return self._nothing_held
        motions = self._read_optional(self._bodies, context)
        slip = self._read_optional(self._slip, context) or NO_SLIP
        body = None if motions is None else motions.find(HELD_BODY)
        if not isinstance(body, HeldBody) or not body.is_seen:
            return doubt(state, slip, self._config)
        end_effector = self._read(self._end_effector, context)
        hand = bent_hand(end_effector, self._read(self._bending, context))
        if state.hand is None:
            return start_state(hand, body, self._config)
        displacement = float(np.linalg.norm(hand.X_WH[:3, 3] - state.hand.X_WH[:3, 3]))
        filters = [predict_filter(f, self._config, displacement) for f in state.filters]
        state = replace(state, filters=filters)
        if body.seen is None:
            return reaffirm(state, hand, body, slip, self._config)
        return learn(state, hand, body.seen, body.seen_offset_covariance, slip, self._config)
