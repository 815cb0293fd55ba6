"""When the flipping of a flap goes on to its next phase, and when it is given up."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np

from crossmodal.controllers.servoing.contact_search import (
    backed_off,
    hinge_shift,
    is_there,
    next_on_arc,
    probe_offset,
    turned_about,
)
from crossmodal.controllers.servoing.flip_config import FlipSequenceConfig
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

_PATIENCE = 3.0  # Longest time of a flip or a retreat, as a multiple of the planned one.


class FlipPhase(IntEnum):
    """In the order in which they follow; a lost contact leads from FLIP back."""

    PRE_CONTACT = 0
    ESTABLISH_CONTACT = 1
    FLIP = 2
    RETREAT = 3
    DONE = 4
    FAILED = 5


@dataclass(frozen=True, kw_only=True)
class ContactPose(Immutable):
    """A pose in which the finger touched the edge, or would have.

    Attributes:
        time: Of it, [s].
        X_WS: The pose (4, 4).
        theta: Angle of the flap at that time, as perceived, [rad]; NaN if unknown.
    """

    time: float
    X_WS: Array
    theta: float


@dataclass(frozen=True, kw_only=True)
class FlipState(Immutable):
    """What the sequence remembers.

    Attributes:
        phase: What is done.
        since: Beginning of the phase, [s].
        sensed_at: When something was last sensed, [s].
        good_since: Since when the contact has been as it should be, [s]; infinite while it is not.
        n_S: Normal of the last contact (3,); y of S before the first.
        p_WS_last: Where a search's displacement is counted from (3,), [m]: where a contact was last
            sensed or expected, or the start.
        contact_pose: How finger and flap fit together; None before a contact was good for long.
        candidate: What becomes that if the contact stays good; None while it is not.
        X_WS_goal: Where it waits before an edge that has gone (4, 4); None while it does not.
        reached: Turn of the flap since `contact_pose` with which the finger has gone, [rad].
        probe: How many places beside the expected one the edge has been sought at.
        flipped: Time since the flip began without the pauses, [s].
        turned: By how much the finger has turned about its own z since the flip began, [rad].
        displacement: Of the fingertip along its x since then, [m].
        X_WS: Pose at the last update (4, 4); NaN before the first.
        waits: Whether it does not go on, since touch cannot be trusted or since the finger still
            turns to the flap as it is seen.
        losses: How often the contact was lost.
        why: Why it failed, in words; empty if it has not.
    """

    phase: FlipPhase = FlipPhase.PRE_CONTACT
    since: float = 0.0
    sensed_at: float = -np.inf
    good_since: float = np.inf
    n_S: Array
    p_WS_last: Array
    contact_pose: ContactPose | None = None
    candidate: ContactPose | None = None
    X_WS_goal: Array | None = None
    reached: float = 0.0
    probe: int = 0
    flipped: float = 0.0
    turned: float = 0.0
    displacement: float = 0.0
    X_WS: Array
    waits: bool = False
    losses: int = 0
    why: str = ""

    @property
    def is_seeking(self) -> bool:
        """Whether the finger moves towards a contact that it does not sense."""
        seeking = self.phase in (FlipPhase.PRE_CONTACT, FlipPhase.ESTABLISH_CONTACT)
        return seeking and not self.waits


_PAD_NORMAL = np.array([0.0, 1.0, 0.0])
FIRST = FlipState(n_S=_PAD_NORMAL, p_WS_last=np.full(3, np.nan), X_WS=np.full((4, 4), np.nan))


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What the sequence decides by, at one instant.

    Attributes:
        time: [s]
        X_WS: Measured pose of the fingertip (4, 4).
        contact: `TactileContact`.
        theta: Angle of the flap as it is perceived, [rad]; NaN while unknown.
        hinge: `HingeBelief`; None while unknown.
        distrust: Why touch does not show whether there is a contact; empty while it does.
        misalignment: Angle by which the finger is still to turn to a flap that is seen and was
            never touched, [rad].
    """

    time: float
    X_WS: Array
    contact: Any
    theta: float = float("nan")
    hinge: Any = None
    distrust: str = ""
    misalignment: float = 0.0


def own_turn(X_WS_before: Array, X_WS: Array) -> float:
    """By how much a frame has turned about its own z between two poses near each other, [rad]."""
    R = X_WS_before[:3, :3].T @ X_WS[:3, :3]
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))


def is_good(contact: Any, config: FlipSequenceConfig) -> bool:
    """Whether a contact has about the force and the place that it should have."""
    place = np.hypot(contact.p_SC[0], contact.p_SC[2])
    force = abs(contact.force - config.force)
    return bool(place < config.position_tolerance and force < config.force_tolerance)


def next_flip_state(state: FlipState, now: Sensed, config: FlipSequenceConfig) -> FlipState:
    """One step of the sequence."""
    if state.phase in (FlipPhase.DONE, FlipPhase.FAILED):
        return state
    state = _observe(state, now, config)
    sought = float(np.linalg.norm(now.X_WS[:3, 3] - state.p_WS_last))
    if state.phase == FlipPhase.RETREAT:
        return _retreat(state, now, sought, config)
    state = replace(state, waits=bool(now.distrust))
    if state.waits:
        return _wait(state, now, config)
    if state.phase == FlipPhase.PRE_CONTACT:
        if now.contact.touching:
            return _enter(state, FlipPhase.ESTABLISH_CONTACT, now)
        if sought > config.approach_displacement:
            return _fail(state, now, "nothing was touched")
        if now.time - state.since > config.search_time:
            return _fail(state, now, "the finger does not get to the flap as it is seen")
        return replace(state, waits=now.misalignment > config.arrival_angle)
    if now.time - state.sensed_at > config.lost_time:
        if state.phase == FlipPhase.FLIP:
            lost = replace(state, losses=state.losses + 1)
            return _enter(lost, FlipPhase.ESTABLISH_CONTACT, now)
        over = now.time - state.sensed_at > config.search_time or state.probe > config.probes
        if over or sought > config.search_displacement:
            return _fail(state, now, "the contact was lost and the edge is not found again")
        return follow_edge(replace(state, since=now.time), now, config)
    if state.phase == FlipPhase.ESTABLISH_CONTACT:
        settled = now.time - state.good_since >= config.settle_time
        if settled or now.time - state.since >= config.establish_time:
            return _enter(state, FlipPhase.FLIP, now)
        return state
    turned = now.theta if np.isfinite(now.theta) else state.turned
    there = turned >= config.angle and now.contact.touching
    if there or state.displacement >= config.displacement:
        return _enter(state, FlipPhase.RETREAT, now)
    if state.flipped > _PATIENCE * config.displacement / config.feed_speed:
        return _fail(state, now, "the flap took too long to turn")
    return state


def _wait(state: FlipState, now: Sensed, config: FlipSequenceConfig) -> FlipState:
    """The state while touch may come back: nothing moves that it would have to stop."""
    if now.time - max(state.sensed_at, state.since) > config.search_time:
        return _fail(state, now, f"touch cannot be trusted: {now.distrust}")
    if state.phase == FlipPhase.FLIP:
        return _enter(state, FlipPhase.ESTABLISH_CONTACT, now)
    return state


def _retreat(
    state: FlipState, now: Sensed, distance: float, config: FlipSequenceConfig
) -> FlipState:
    """Done once the finger is so far [m] from where it last touched."""
    farthest = float(np.linalg.norm(config.retreat))
    if distance >= farthest:
        return _enter(state, FlipPhase.DONE, now)
    if now.time - state.since > _PATIENCE * farthest / config.retreat_speed:
        return _fail(state, now, "the finger does not get away from the flap")
    return state


def follow_edge(state: FlipState, now: Sensed, config: FlipSequenceConfig) -> FlipState:
    """The state with the goal before an edge that has gone, until it is reached.

    Where it has gone is seen, or else tried: an edge that is not sensed where it should be is
    sought beside that place.
    """
    contact_pose = state.contact_pose
    if contact_pose is None or now.hinge is None or not np.isfinite(now.theta - contact_pose.theta):
        return state
    p_WS = now.X_WS[:3, 3]
    lever = hinge_shift(now.hinge, 1.0, contact_pose.X_WS[:3, 3])
    turn = now.theta - contact_pose.theta + probe_offset(state.probe, config.probe_step / lever)
    if lever * abs(turn - state.reached) <= config.edge_shift:
        backed = config.clearance if state.reached != 0.0 else 0.0
        passed = float(np.linalg.norm(p_WS - state.p_WS_last)) > backed + config.probe_depth
        return replace(state, X_WS_goal=None, probe=state.probe + passed)
    goal = backed_off(turned_about(now.hinge, turn, contact_pose.X_WS), config.clearance)
    if is_there(now.X_WS, goal, config.arrival_distance, config.arrival_angle):
        return replace(state, X_WS_goal=None, reached=turn, p_WS_last=p_WS)
    # It first draws back, then goes along the arc.
    is_outside = hinge_shift(now.hinge, 1.0, p_WS) > lever + 0.5 * config.clearance
    step = config.arc_step if is_outside else 0.0
    angle = next_on_arc(now.hinge, contact_pose.X_WS, turn, now.X_WS, step)
    goal = backed_off(turned_about(now.hinge, angle, contact_pose.X_WS), config.clearance)
    return replace(state, X_WS_goal=goal, p_WS_last=p_WS, n_S=_PAD_NORMAL)


def _fit(state: FlipState, now: Sensed, config: FlipSequenceConfig) -> FlipState:
    """The state with what is known of how finger and flap fit together.

    A contact that is about to be lost is not believed: it has to stay good for a while.
    """
    here = ContactPose(time=now.time, X_WS=now.X_WS, theta=now.theta)
    candidate = state.candidate
    if candidate is None:
        return replace(state, candidate=here)
    if now.time - candidate.time < config.settle_time:
        return state
    return replace(state, contact_pose=candidate, reached=0.0, candidate=here)


def _observe(state: FlipState, now: Sensed, config: FlipSequenceConfig) -> FlipState:
    """The state with what is sensed and how the finger has moved."""
    if np.isnan(state.X_WS[0, 0]):
        state = replace(state, X_WS=now.X_WS, p_WS_last=now.X_WS[:3, 3])
    if now.contact.touching:
        good = is_good(now.contact, config)
        state = replace(
            state,
            sensed_at=now.time,
            n_S=now.contact.n_S,
            p_WS_last=now.X_WS[:3, 3],
            X_WS_goal=None,
            probe=0,
            good_since=min(state.good_since, now.time) if good else np.inf,
        )
        state = _fit(state, now, config) if good else replace(state, candidate=None)
    else:
        state = replace(state, good_since=np.inf, candidate=None)
    flipping = state.phase == FlipPhase.FLIP
    if flipping or state.flipped > 0.0:
        state = replace(
            state,
            flipped=state.flipped + config.period * flipping,
            turned=state.turned + own_turn(state.X_WS, now.X_WS),
            displacement=state.displacement
            + float(now.X_WS[:3, 0] @ (now.X_WS[:3, 3] - state.X_WS[:3, 3])),
        )
    return replace(state, X_WS=now.X_WS)


def _enter(state: FlipState, phase: FlipPhase, now: Sensed) -> FlipState:
    return replace(state, phase=phase, since=now.time, good_since=np.inf)


def _fail(state: FlipState, now: Sensed, why: str) -> FlipState:
    return replace(_enter(state, FlipPhase.FAILED, now), why=why)
