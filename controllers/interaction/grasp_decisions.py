"""When a manipulation goes on to its next phase, and when a grasp is given up."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.controllers.interaction.phases import Phase, is_held
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable


@dataclass(kw_only=True)
class SequenceState(Immutable):
    """What the sequence remembers; never written after it is made.

    Attributes:
        phase: What is done.
        since: Beginning of the phase, [s].
        X_WE_start: The end-effector's pose at that time (4, 4).
        X_WE_grasp: Pose at which the hand closes or has closed (4, 4), if not in another way.
        q_grasp: The joint's perceived configuration at that pose, [m or rad].
        X_WE_held: The end-effector's pose when the hand had closed (4, 4).
        pressure_held: The chambers' pressure at that time (chambers,), [Pa].
        task: Phase that follows CLOSE: EXPLORE, or RETURN once exploration is over.
        attempts: Number of grasps that were tried again.
        lost: Whether the grasp is believed lost.
        stuck: Whether nothing moved although the hand held on.
        doubted_since: Time since which the grasp is in doubt, infinite while it is not, [s].
    """

    phase: Phase
    since: float
    X_WE_start: Array
    X_WE_grasp: Array
    q_grasp: float
    X_WE_held: Array
    pressure_held: Array
    task: Phase
    attempts: int
    lost: bool
    stuck: bool
    doubted_since: float


@dataclass(kw_only=True)
class Perceived:
    """What the sequence decides by, at one instant.

    Attributes:
        time: [s]
        X_WE: The end-effector's measured pose (4, 4).
        pressure: Measured in the chambers (chambers,), [Pa]; NaN where it is not known.
        pull: Force with which the arm pulls, [N]; NaN where it is not known.
        joint: (8,) the body's unit screw S_W, q and its rate; NaN until a joint is perceived, the
            rate whenever it is only remembered.
        hand_rate: Displacement of the hand per unit of q, [m per m or rad]; NaN until a joint is
            perceived.
        failure: Probability that the hand has lost the body; NaN where it is not known.
        plan_time_left: Time to the planned end of the return, [s].
    """

    time: float
    X_WE: Array
    pressure: Array
    pull: float
    joint: Array
    hand_rate: float
    failure: float
    plan_time_left: float


@dataclass(kw_only=True)
class Goal:
    """What a manipulation is for.

    Attributes:
        configuration: Perceived configuration of the joint, of either sign, at which exploration
            ends, [m or rad]; None ends it by the hand's displacement.
        return_to_start: Whether the joint is then brought back to where it was.
    """

    configuration: float | None = None
    return_to_start: bool = False


def moved_by_joint(X_WE: Array, joint: Array, q: float) -> Array:
    """Where the joint, (8,) S_W, q and its rate, has taken a pose of E that it had at another q."""
    if np.isnan(joint[6]):
        return X_WE
    return np.asarray(se3.exp(joint[:6] * (joint[6] - q)) @ X_WE)


def tried_pose(state: SequenceState, config: GraspSequenceConfig) -> Array:
    """Pose of E (4, 4) at which the hand closes at this try; see `other_grasps`."""
    if not config.other_grasps or state.attempts == 0:
        return state.X_WE_grasp
    turn = 0.5 * np.pi if state.attempts > 1 else 0.0
    return np.asarray(state.X_WE_grasp @ se3.exp(np.array([0, 0, turn, 0, 0, config.closer])))


def is_doubtful(state: SequenceState, now: Perceived, config: GraspSequenceConfig) -> bool:
    """Whether the hand seems to hold nothing: each sign alone may be an error of perception."""
    if np.isnan(now.joint[7]) and not np.isnan(now.joint[6]):
        return False
    X_WE = moved_by_joint(state.X_WE_held, now.joint, state.q_grasp)
    slip = np.linalg.norm(X_WE[:3, 3] - now.X_WE[:3, 3])
    believed = np.isnan(now.failure) or now.failure > config.failure_probability
    return bool(believed and slip > config.slip)


def is_empty(state: SequenceState, now: Perceived, config: GraspSequenceConfig) -> bool:
    """Whether every finger has curled further than around the handle and the pull meets nothing.

    Around a thin bar, on which the hand shifts as it pulls, the fingers curl further and further,
    too, but then the arm has to pull.
    """
    curled = np.all(now.pressure < config.empty_pressure * state.pressure_held)
    return bool(curled) and not now.pull > config.empty_pull


def next_state(
    state: SequenceState, now: Perceived, goal: Goal, config: GraspSequenceConfig
) -> SequenceState:
    """One step of the sequence."""
    elapsed = now.time - state.since
    ends = {
        Phase.RELEASE: config.release_time,
        Phase.APPROACH: config.approach_time,
        Phase.CLOSE: config.close_time,
        Phase.EXPLORE: config.explore_time_limit,
    }
    over = elapsed >= ends.get(state.phase, np.inf)
    if state.phase == Phase.STOP:
        return state
    if state.phase < Phase.CLOSE:
        return _enter(state, Phase(state.phase + 1), now) if over else state
    if state.phase == Phase.CLOSE:
        if not over:
            return state
        state = _enter(state, state.task, now)
        return replace(state, X_WE_held=now.X_WE, pressure_held=now.pressure)
    if goal.configuration is not None:
        doubted = is_doubtful(state, now, config)
        since = min(state.doubted_since, now.time) if doubted else np.inf
        state = replace(state, doubted_since=since)
    doubted_long = now.time - state.doubted_since >= config.doubt_time
    lost = doubted_long or is_empty(state, now, config)
    if state.phase == Phase.RETURN:
        late = now.plan_time_left <= -config.return_patience
        there = abs(now.joint[6]) * now.hand_rate <= config.return_tolerance
        over = (late or lost or bool(there)) and now.plan_time_left <= 0.0
        if over and lost and not there:
            return _lose_grasp(state, now, goal, config)
        return _enter(state, Phase.STOP, now) if over else state
    if lost:
        return _lose_grasp(state, now, goal, config)
    known = not np.isnan(now.joint[6])
    displacement = float(np.linalg.norm(now.X_WE[:3, 3] - state.X_WE_start[:3, 3]))
    if elapsed >= config.stuck_time and displacement < config.give:
        return replace(_enter(state, Phase.STOP, now), stuck=True)
    over = (over or displacement >= config.travel) and np.isinf(state.doubted_since)
    if goal.configuration is not None and known:
        q = now.joint[6] + config.anticipation * np.nan_to_num(now.joint[7])
        over = over or bool(abs(q) >= goal.configuration)
    if not over:
        return state
    if goal.configuration is not None and not known:
        return _lose_grasp(state, now, goal, config)
    following = Phase.RETURN if goal.return_to_start else Phase.STOP
    return replace(_enter(state, following, now), task=following)


def _enter(state: SequenceState, phase: Phase, now: Perceived) -> SequenceState:
    return replace(
        state,
        phase=phase,
        since=now.time,
        X_WE_start=now.X_WE,
        lost=state.lost and not is_held(phase),
        doubted_since=np.inf,
    )


def _lose_grasp(
    state: SequenceState, now: Perceived, goal: Goal, config: GraspSequenceConfig
) -> SequenceState:
    """Goes back to the handle where the hand is near and has not tried too often, else stops.

    Without a perceived goal nobody knows where the handle has gone, so it stops, unless other
    grasps are to be tried: then it goes back to where the handle was, and pushes it there.
    """
    X_WE_grasp = moved_by_joint(state.X_WE_grasp, now.joint, state.q_grasp)
    near = np.linalg.norm(X_WE_grasp[:3, 3] - now.X_WE[:3, 3]) <= config.retry_distance
    is_known = near and goal.configuration is not None
    if not (is_known or config.other_grasps) or state.attempts >= config.retries:
        return replace(_enter(state, Phase.STOP, now), lost=True)
    return replace(
        _enter(state, Phase.RELEASE, now),
        lost=True,
        X_WE_grasp=X_WE_grasp,
        q_grasp=0.0 if np.isnan(now.joint[6]) else float(now.joint[6]),
        attempts=state.attempts + 1,
    )
