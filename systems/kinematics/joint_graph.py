"""Bodies and the joint filters of their pairs over time, and what each joint predicts.

Frames: W world, P parent, B child, F the child's measured reference pose. Until a parent began to
move it belonged to the environment, so that the child's joint to the environment was its joint to
the parent too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.gaussian import chi_square_gate, nees
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersState, skip
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.kinematics.joint_pairs import (
    Pair,
    constant_error,
    measured_pose,
    possible_pairs,
    scheduled_pairs,
)
from crossmodal.systems.kinematics.measurement_errors import EXACT
from crossmodal.systems.kinematics.pose_checks import SkipReason, covariance_fault, pose_fault
from crossmodal.systems.kinematics.seen_body import (
    UNSEEN,
    SeenBody,
    as_seen,
    find_seen,
    moves_alike,
    of_held,
)
from crossmodal.systems.port_values import (
    HEALTHY,
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    BodyPrediction,
    BodyPredictions,
    HeldBody,
    JointType,
    MotionBelief,
    PoseBelief,
    StreamHealth,
)
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class KinematicModelConfig(Ticked):
    """Configuration of `KinematicModel`.

    Attributes:
        filters: Of every pair.
        reference_age: How long before a body was first measured its reference may be.
        patience: How long a pair outlives its bodies' measurements.
        max_pairs: Most pairs that are updated in a tick. Those with the static environment always
            are; the others by a schedule.
        transfer_window: How long ago a body may have stood still last, for what is known of another
            one's joint to the environment to be transferred to the joint between the two.
        rest_walk: Standard deviation of how far a parent that is not measured any more has moved
            after one second, and turned by that over `filters.radius`; it is taken to rest for as
            long as it was followed.
        least_probability: Of a joint type, for its prediction to be sent down.
    """

    filters: JointFiltersConfig = field(default_factory=JointFiltersConfig)
    reference_age: float = number(1.0, at_least=1e-3, at_most=3600.0, unit="s")
    patience: float = number(1.0, at_least=0.0, at_most=3600.0, unit="s")
    max_pairs: int = number(10, at_least=1, at_most=100)
    transfer_window: float = number(3.0, at_least=1e-3, at_most=3600.0, unit="s")
    rest_walk: float = number(0.015, at_least=1e-9, at_most=10.0, unit="m")
    least_probability: float = number(0.01, at_least=0.0, at_most=1.0)


@dataclass(kw_only=True)
class JointGraphState(Immutable):
    """Bodies, and joints between pairs of them, at one tick.

    Attributes:
        pairs: Each pair's filters.
        bodies: Each body when it was last measured, or resting since then.
        past: Each body's filters with the environment within the transfer window, oldest first.
        unseen: Ticks since each body was measured.
        ticks: Number of this tick, from one on.
        seen: Which body of vision's the one in the hand is; joints of the held body, other than
            that with the seen one, are of the seen one's frame.
        closed_at: X_PB of the held body where the hand closed, by its parent; of all that had
            moved by then, where vision had seen the held body before.
        is_sighted: Whether features have shown the held body since the hand closed.
        health: Of the bodies' poses at this tick.
    """

    pairs: dict[Pair, JointFiltersState]
    bodies: dict[int, BodyMotion]
    past: dict[int, list[JointFiltersState]]
    unseen: dict[int, int]
    ticks: int
    seen: SeenBody = UNSEEN
    closed_at: dict[int, PoseBelief] = field(default_factory=dict)
    is_sighted: bool = False
    health: StreamHealth = HEALTHY


# Squared velocity, by its covariance, that one body at rest in twenty exceeds.
_MOVING = chi_square_gate(0.05, 6)
# No body's count of resets, so that the next pose is taken to have another constant error.
_ANEW = -1
# Neither is this, by which a pair's filters begin again at the reference that they have.
_RESTART = -2
EMPTY_GRAPH = JointGraphState(pairs={}, bodies={}, past={}, unseen={}, ticks=0)


def body_fault(body: BodyMotion) -> SkipReason | None:
    """Why a body's motion cannot be used; None where it can be true."""
    offset = body.offset_covariance, body.reference_offset_covariance
    own = body.motion.covariance[:6, :6] - body.offset_covariance
    covariances = map(np.ascontiguousarray, (own, body.correlated_covariance, *offset))
    faults = [pose_fault(X) for X in (body.motion.X, body.X_WB_reference)]
    faults += [covariance_fault(P) for P in covariances]
    return next(filter(None, faults), None)


def merge_bodies(
    sources: Sequence[BodyMotions],
) -> tuple[dict[int, BodyMotion], dict[int, SkipReason]]:
    """Bodies by id, a later source overriding an earlier one, and what was left out of them.

    A body with a fault counts as not measured by that source. The held body counts only as the
    `HeldBody` of the hand: vision has it where the hand expects it, also after a lost grip.
    """
    found: dict[int, BodyMotion] = {}
    faults: dict[int, SkipReason] = {}
    for source in sources:
        for body in source.bodies:
            if body.body_id == HELD_BODY and not isinstance(body, HeldBody):
                continue
            if fault := body_fault(body):
                faults[body.body_id] = fault
            else:
                found[body.body_id] = body
    return found, faults


def transferred(
    pair: Pair, bodies: dict[int, BodyMotion], past: list[JointFiltersState], time: float
) -> JointFiltersState | None:
    """The child's filters with the environment when the parent still belonged to it.

    Poses of the child are relative to its own reference X_PF, so that only this is changed: to the
    frame of the parent where it stood. None where that was before the transfer window.
    """
    parent = bodies[pair[0]]
    stood = time - parent.reference_age  # An unknown age, NaN, finds no state.
    earlier = [state for state in past if state.time <= stood + 1e-9]
    if not earlier:
        return None
    X_PF = se3.inverse(parent.X_WB_reference) @ earlier[-1].X_PF
    return replace(earlier[-1], parent_id=pair[0], X_PF=X_PF)


def at_rest(body: BodyMotion, config: KinematicModelConfig) -> BodyMotion:
    """A body that is not measured any more, one tick later: at rest, with growing covariance."""
    walk = config.rest_walk * np.repeat([1.0 / config.filters.radius, 1.0], 3)
    growth = np.diag(walk**2 * config.period)
    covariance = body.motion.covariance.copy()
    covariance[:6, :6] += growth
    return replace(
        body,
        motion=MotionBelief(X=body.motion.X, V=np.zeros(6), covariance=covariance),
        correlated_covariance=body.correlated_covariance + growth,
        reference_age=body.reference_age + config.period,
    )


def resting_parents(
    graph: JointGraphState, bodies: dict[int, BodyMotion], config: KinematicModelConfig
) -> dict[int, BodyMotion]:
    """Parents that are lost, as predicted: at rest for as long as they were followed.

    Not those that moved when they were lost, of which nobody knows how far they went.

    Args:
        bodies: At this tick, also those that are followed and not seen.
    """
    lost = {parent for parent, child in graph.pairs if parent not in bodies and child in bodies}
    resting = {}
    for body_id in sorted(lost - {STATIC_BODY}):
        body, unseen = graph.bodies[body_id], config.period * (graph.unseen[body_id] + 1)
        V, covariance = body.motion.V, body.motion.covariance[6:, 6:]
        if nees(V, covariance + EXACT) > _MOVING:
            continue
        if 2.0 * unseen <= body.reference_age:  # An unknown age, NaN, is not enough.
            resting[body_id] = at_rest(body, config)
    return resting


def recognised(
    graph: JointGraphState,
    bodies: Mapping[int, BodyMotion],
    config: KinematicModelConfig,
) -> JointGraphState:
    """The graph before this tick's update, with what vision knew of the body that the hand holds.

    When the hand has closed, the held body takes over the joints of the body that it is, whose
    configurations count from before. Where the two turn out not to move alike, the held body's
    joints begin anew. Once vision has no such body any more, since it has been told that this is
    the held one or has lost it, only the held one measures its joints.
    """
    seen = graph.seen
    if HELD_BODY not in bodies or not bodies[HELD_BODY].is_seen:
        return graph
    held = bodies[HELD_BODY]
    if HELD_BODY not in graph.bodies:
        known = [child for parent, child in graph.pairs if parent == STATIC_BODY]
        seen = find_seen(held, bodies, known, config.transfer_window)
        graph = replace(graph, seen=seen, closed_at={}, is_sighted=False)
        return graph if seen.body_id == STATIC_BODY else _handed_over(graph, bodies)
    if not seen.is_followed:
        return _sighted(graph, held)
    own = {pair: state for pair, state in graph.pairs.items() if pair[1] == HELD_BODY}
    of_seen = {pair for pair in graph.pairs if seen.body_id in pair}
    if seen.body_id not in bodies:
        before, count = graph.bodies.get(seen.body_id), _ANEW
        shared = np.isin(held.feature_ids, [] if before is None else before.feature_ids)
        if before is not None and isinstance(held, HeldBody) and shared.any():
            # The same landmarks go on, in the frame of the held body, and so do their errors.
            X_KB = se3.inverse(before.X_WB_reference) @ held.seen_reference
            seen, count = replace(seen, X_KB=X_KB), held.reset_count
        anew = {pair: replace(state, reset_count=count) for pair, state in own.items()}
        pairs = {**graph.pairs, **anew}
        pairs = {pair: state for pair, state in pairs.items() if pair not in of_seen}
        return replace(graph, pairs=pairs, seen=replace(seen, is_followed=False))
    body = bodies[seen.body_id]
    if not body.is_seen or moves_alike(seen, held, body):
        return graph
    # Those with what it was taken for have been its own since the hand closed.
    kept = {pair: state for pair, state in graph.pairs.items() if pair not in own}
    kept |= {pair: state for pair, state in own.items() if pair in of_seen}
    past = {child: states for child, states in graph.past.items() if child != HELD_BODY}
    return replace(graph, pairs=kept, past=past, seen=UNSEEN, closed_at={})


def _sighted(graph: JointGraphState, held: BodyMotion) -> JointGraphState:
    """The graph in which the held body's joints begin anew where features tell its motion.

    The hand says where the body was when it closed to some millimetres, features that rested until
    then exactly.
    """
    if graph.is_sighted or not isinstance(held, HeldBody) or held.seen is None:
        return graph
    pairs = graph.pairs
    if (
        graph.seen.body_id == STATIC_BODY
        and held.reset_count == graph.bodies[HELD_BODY].reset_count
    ):
        pairs = {
            pair: replace(state, reset_count=_RESTART) if pair[1] == HELD_BODY else state
            for pair, state in pairs.items()
            if pair != (STATIC_BODY, HELD_BODY)  # That begins at the body's own reference.
        }
    return replace(graph, pairs=pairs, is_sighted=True)


def _handed_over(graph: JointGraphState, bodies: Mapping[int, BodyMotion]) -> JointGraphState:
    """The graph in which the held body has the joints of the seen one, too."""
    seen, present = graph.seen.body_id, {**graph.bodies, **bodies}
    taken = {parent: state for (parent, child), state in graph.pairs.items() if child == seen}
    own = {
        (parent, HELD_BODY): replace(state, child_id=HELD_BODY) for parent, state in taken.items()
    }
    parents = {STATIC_BODY, *present} - {seen, HELD_BODY}
    closed_at = {parent: measured_pose((parent, seen), present)[0] for parent in parents}
    past = {**graph.past, HELD_BODY: graph.past[seen]}
    return replace(graph, pairs={**graph.pairs, **own}, past=past, closed_at=closed_at)


def grasp_configuration(
    graph: JointGraphState, pair: Pair, joint_type: JointType, filters: JointFilters
) -> float:
    """The configuration of a pair where the hand closed, by a type that moves; zero by default."""
    parent, child = pair
    is_taken = child == HELD_BODY and parent != graph.seen.body_id
    if not is_taken or STATIC_BODY not in graph.closed_at:
        return 0.0
    pose = graph.closed_at.get(parent)
    if pose is None:  # A parent that began to move later stood at its reference.
        pose = graph.closed_at[STATIC_BODY]
        pose = replace(pose, X=se3.inverse(graph.bodies[parent].X_WB_reference) @ pose.X)
    return filters.configuration_at(graph.pairs[pair], joint_type, pose.X, pose.covariance)


def _update_pair(
    pair: Pair,
    graph: JointGraphState,
    bodies: dict[int, BodyMotion],
    filters: JointFilters,
    config: KinematicModelConfig,
) -> JointFiltersState | None:
    """The filters of one pair after this tick's measurement, where needed started or rebased.

    None where the measurement is too bad to start with.
    """
    time = (graph.ticks + 1) * config.period
    pose, correlated, X_PB_reference = measured_pose(pair, bodies)
    reset_count = sum(bodies[i].reset_count for i in pair if i != STATIC_BODY)
    offset, of_reference = constant_error(pair, bodies)
    state = graph.pairs.get(pair)
    if state is None and pair[0] != STATIC_BODY:
        state = transferred(pair, bodies, graph.past.get(pair[1], []), time)
    if state is None:
        if pose_fault(pose.X) or pose_fault(X_PB_reference):
            return None
        body = bodies[pair[1]]
        if pair[1] == HELD_BODY and pair[1] not in graph.bodies:
            # The body in the hand is first measured at its reference. Closing the hand may have
            # moved its parent away from the parent's own.
            delay = body.reference_delay if isinstance(body, HeldBody) else 0.0
            state = filters.start(pose.X, pose.covariance, time, *pair, correlated, delay)
            return replace(state, reset_count=reset_count, offset=offset)
        age = body.reference_age if body.reference_age > 0.0 else config.reference_age
        state = filters.start(X_PB_reference, pose.covariance, time - age, *pair, correlated)
    elif state.reset_count == _RESTART:
        state = filters.start(state.X_PF, pose.covariance, state.zero_time, *pair, correlated)
    elif reset_count != state.reset_count:
        state = filters.rebase(state, time, offset, of_reference + correlated)
    state = replace(state, reset_count=reset_count, offset=offset)
    return filters.update(state, pose.X, pose.covariance, time, correlated)


def update_graph(
    graph: JointGraphState,
    bodies: dict[int, BodyMotion],
    filters: JointFilters,
    config: KinematicModelConfig,
    faults: Mapping[int, SkipReason] | None = None,
) -> JointGraphState:
    """The graph one tick later.

    Args:
        bodies: At this tick, by id. One that is not seen measures no joint, but its joints stay for
            as long as it is followed.
        faults: Of bodies that were left out, by id.
    """
    faults = faults or {}
    time = (graph.ticks + 1) * config.period
    graph = recognised(graph, bodies, config)
    followed = set(bodies)
    resting = resting_parents(graph, bodies, config)
    bodies = {body_id: body for body_id, body in bodies.items() if body.is_seen}
    present = {**resting, **bodies}
    described = {**resting, **as_seen(graph.seen, bodies)}
    possible = [
        pair
        for pair in possible_pairs(bodies, resting)
        if pair[0] not in resting or pair in graph.pairs
    ]
    scheduled = scheduled_pairs(possible, present, graph.pairs, config.max_pairs)
    pairs: dict[Pair, JointFiltersState] = {}
    for pair in sorted({*possible, *graph.pairs}):
        measured = present if pair[0] == graph.seen.body_id else described
        if pair in scheduled and pair[1] in measured:
            state = _update_pair(pair, graph, measured, filters, config)
        else:
            state = graph.pairs.get(pair)
            is_followed = set(pair) <= {STATIC_BODY, *followed, *resting}
            if state is not None and not is_followed and time - state.time > config.patience:
                state = None
        if state is not None:
            for body_id in set(pair) & set(faults):
                state = skip(state, faults[body_id])
            pairs[pair] = state
    window = max(1, round(config.transfer_window / config.period))
    past = {
        child: [*graph.past.get(child, []), state][-window:]
        for (parent, child), state in pairs.items()
        if parent == STATIC_BODY
    }
    known = {i: body for i, body in graph.bodies.items() if any(i in pair for pair in pairs)}
    unseen = {i: graph.unseen[i] + 1 for i in known} | dict.fromkeys(bodies, 0)
    return JointGraphState(
        pairs=pairs,
        bodies={**known, **present},
        past=past,
        unseen=unseen,
        ticks=graph.ticks + 1,
        seen=graph.seen,
        closed_at=graph.closed_at,
        is_sighted=graph.is_sighted,
        health=_health(faults, graph, pairs, unseen, config.period),
    )


def _health(
    faults: Mapping[int, SkipReason],
    graph: JointGraphState,
    pairs: dict[Pair, JointFiltersState],
    unseen: dict[int, int],
    period: float,
) -> StreamHealth:
    """Of the bodies' poses: the faults of this tick, and since when the worst body is without."""
    found = [f"body {body_id}: {faults[body_id]}" for body_id in sorted(faults)]
    for pair, state in pairs.items():
        before = graph.pairs[pair].skipped if pair in graph.pairs else {}
        known = {faults[body_id] for body_id in pair if body_id in faults}
        found += [
            f"body {pair[1]} on {pair[0]}: {reason}"
            for reason, count in state.skipped.items()
            if count > before.get(reason, 0) and reason not in known
        ]
    ages = [period * unseen.get(body_id, 0) for body_id in faults]
    return StreamHealth(age=max(ages, default=0.0), fault="; ".join(found))


def is_felt_alone(graph: JointGraphState, body_id: int) -> bool:
    """Whether a body is the one in the hand, and no eye has seen it move."""
    return body_id == HELD_BODY and not graph.is_sighted and graph.seen.body_id == STATIC_BODY


def predict_bodies(
    graph: JointGraphState, filters: JointFilters, config: KinematicModelConfig
) -> BodyPredictions:
    """Where each joint expects its child at the next tick, the likeliest first, for each child.

    The disconnected type predicts nothing and is left out.
    """
    found: list[tuple[float, BodyPrediction]] = []
    parents = {
        parent: _predicted(graph.bodies[parent].motion, config.period)
        for parent in {parent for parent, _ in graph.pairs} - {STATIC_BODY}
    }
    for (parent_id, child_id), state in graph.pairs.items():
        dt = (graph.ticks + 1) * config.period - state.time
        for joint_type, probability in filters.probabilities(state).items():
            if joint_type == JointType.DISCONNECTED or probability < config.least_probability:
                continue
            pose = filters.predict(state, joint_type, dt)
            if child_id == HELD_BODY and parent_id != graph.seen.body_id:
                pose = of_held(graph.seen, pose)
            source = joint_type.value
            if parent_id != STATIC_BODY:
                Ad, parent = se3.adjoint(se3.inverse(pose.X)), parents[parent_id]
                covariance = pose.covariance + Ad @ parent.covariance @ Ad.T
                pose = PoseBelief(X=parent.X @ pose.X, covariance=covariance)
                source = f"{source} on {parent_id}"
            prediction = BodyPrediction(body_id=child_id, source=source, pose=pose)
            found.append((probability, prediction))
    found.sort(key=lambda item: (item[1].body_id, -item[0]))
    return BodyPredictions(predictions=[prediction for _, prediction in found])


def _predicted(body: MotionBelief, period: float) -> PoseBelief:
    """X_WB of a body that goes on at its velocity."""
    step = body.V * period
    J = np.hstack([se3.adjoint(se3.exp(-step)), period * se3.right_jacobian(step)])
    return PoseBelief(X=body.X @ se3.exp(step), covariance=J @ body.covariance @ J.T)
