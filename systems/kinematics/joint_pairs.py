"""Which pairs of bodies have joint filters, and what each pair measures and predicts.

Frames: W world, P parent, B child, F the child's measured reference pose. A pair is (parent id,
child id); the parent is `STATIC_BODY` or the body with the higher id, the younger one: until it
began to move it belonged to the environment, so that what the environment says about the child's
way is what the parent says about it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maths import se3
from maths.arrays import Array
from maths.immutable import Immutable
from systems.kinematics.joint_filters import JointFilters, JointFiltersState
from systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    BodyPrediction,
    JointType,
    MotionBelief,
    PoseBelief,
)

Pair = tuple[int, int]


@dataclass(kw_only=True)
class PairLevel(Immutable):
    """All pairs at one tick; never changed in place, so copies share it.

    Attributes:
        pairs: Each pair's filters.
        bodies: Each body when it was last measured, or resting since then.
        past: Each body's filters with the environment at the last ticks, the oldest first.
        unseen: Ticks since each body was measured.
        ticks: Number of this tick, from one on.
    """

    pairs: dict[Pair, JointFiltersState]
    bodies: dict[int, BodyMotion]
    past: dict[int, list[JointFiltersState]]
    unseen: dict[int, int]
    ticks: int


def merge_bodies(sources: Sequence[BodyMotions]) -> dict[int, BodyMotion]:
    """Bodies by id; a later source overrides an earlier one.

    A body whose motion is not finite counts as not measured.
    """
    return {
        body.body_id: body
        for source in sources
        for body in source.bodies
        if np.isfinite(body.motion.X).all() and np.isfinite(body.motion.covariance).all()
    }


def wanted_pairs(body_ids: Sequence[int], max_pairs: int) -> list[Pair]:
    """Every body with the static environment first, then the moving bodies with each other."""
    ids = sorted(body_ids)
    pairs = [(STATIC_BODY, child) for child in ids]
    pairs += [(parent, child) for i, child in enumerate(ids) for parent in ids[i + 1 :]]
    return pairs[:max_pairs]


def relative_pose(parent: PoseBelief, child: PoseBelief) -> PoseBelief:
    """X_PB of two independent poses in W."""
    X_PB = se3.inverse(parent.X) @ child.X
    Ad = se3.adjoint(se3.inverse(X_PB))
    return PoseBelief(X=X_PB, covariance=child.covariance + Ad @ parent.covariance @ Ad.T)


def _pose(body: BodyMotion) -> PoseBelief:
    """Since the body was anchored, without the constant error that it has had since then."""
    covariance = body.motion.covariance[:6, :6] - body.offset_covariance
    return PoseBelief(X=body.motion.X, covariance=covariance)


def measured_pose(pair: Pair, bodies: dict[int, BodyMotion]) -> tuple[PoseBelief, Array, Array]:
    """X_PB of a pair now, what lasts of its covariance (6, 6), and X_PB (4, 4) at the reference."""
    child = bodies[pair[1]]
    if pair[0] == STATIC_BODY:
        return _pose(child), child.correlated_covariance, child.X_WB_reference
    parent = bodies[pair[0]]
    X_PB_reference = se3.inverse(parent.X_WB_reference) @ child.X_WB_reference
    pose = relative_pose(_pose(parent), _pose(child))
    Ad = se3.adjoint(se3.inverse(pose.X))
    lasting = child.correlated_covariance + Ad @ parent.correlated_covariance @ Ad.T
    return pose, lasting, X_PB_reference


def inherited(
    pair: Pair, bodies: dict[int, BodyMotion], past: list[JointFiltersState], time: float
) -> JointFiltersState | None:
    """The child's filters with the environment when the parent still belonged to it.

    Poses of the child are relative to its own reference X_PF, so that only this is changed: to the
    frame of the parent where it stood. None where that is too long ago.
    """
    parent = bodies[pair[0]]
    stood = time - parent.reference_age  # NaN finds nothing.
    before = [state for state in past if state.time <= stood + 1e-9]
    if not before:
        return None
    X_PF = se3.inverse(parent.X_WB_reference) @ before[-1].X_PF
    return replace(before[-1], parent_id=pair[0], X_PF=X_PF)


def at_rest(body: BodyMotion, period: float, walk: Array) -> BodyMotion:
    """A body that nobody sees any more, one tick later: where it was, and less and less certainly.

    Args:
        body: At the last tick.
        period: Of the ticks, [s].
        walk: (6,) standard deviation of its pose, in B, after one second, [rad, m].
    """
    growth = np.diag(walk**2 * period)
    covariance = body.motion.covariance.copy()
    covariance[:6, :6] += growth
    return replace(
        body,
        motion=MotionBelief(X=body.motion.X, V=np.zeros(6), covariance=covariance),
        correlated_covariance=body.correlated_covariance + growth,
        reference_age=body.reference_age + period,
    )


def resting_parents(
    level: PairLevel, bodies: dict[int, BodyMotion], period: float, walk: Array
) -> dict[int, BodyMotion]:
    """Parents that are not measured, as predicted: at rest for as long as they were followed."""
    lost = {parent for parent, child in level.pairs if parent not in bodies and child in bodies}
    resting = {}
    for body_id in sorted(lost - {STATIC_BODY}):
        body, unseen = level.bodies[body_id], period * (level.unseen[body_id] + 1)
        if 2.0 * unseen <= body.reference_age:  # NaN is not followed.
            resting[body_id] = at_rest(body, period, walk)
    return resting


def update_pairs(
    level: PairLevel,
    bodies: dict[int, BodyMotion],
    filters: JointFilters,
    period: float,
    reference_age: float,
    patience: float,
    max_pairs: int,
    heritage: int,
    walk: Array,
) -> PairLevel:
    """The level one tick later.

    Args:
        level: At the last tick.
        bodies: Measured at this tick, by id.
        filters: Shared by all pairs.
        period: Of the ticks, [s].
        reference_age: How long before a body was first measured its reference may be, [s].
        patience: How long a pair outlives its bodies' measurements, [s].
        max_pairs: Most pairs at a time.
        heritage: Ticks whose filters with the environment are remembered.
        walk: See `at_rest`.
    """
    time = (level.ticks + 1) * period
    resting = resting_parents(level, bodies, period, walk)
    measured = set(wanted_pairs(list(bodies), max_pairs))
    measured |= {pair for pair in level.pairs if pair[0] in resting and pair[1] in bodies}
    present = {**resting, **bodies}
    pairs: dict[Pair, JointFiltersState] = {}
    for pair in sorted(measured | set(level.pairs)):
        state = level.pairs.get(pair)
        if pair in measured:
            pose, lasting, X_PB_reference = measured_pose(pair, present)
            anchored = sum(present[i].reset_count for i in pair if i != STATIC_BODY)
            if state is None and pair[0] != STATIC_BODY:
                state = inherited(pair, present, level.past.get(pair[1], []), time)
            if state is None:
                age = reference_age
                if pair[1] == HELD_BODY and pair[1] not in level.bodies:
                    # The body in the hand is at its reference when it is first measured; closing
                    # the hand may have moved its parent from where that was first.
                    age, X_PB_reference = period, pose.X
                state = filters.start(X_PB_reference, pose.covariance, time - age, *pair, lasting)
            elif anchored != state.anchored:
                state = filters.refer(state, pose.X, pose.covariance, time, lasting)
            state = replace(state, anchored=anchored)
            pairs[pair] = filters.update(state, pose.X, pose.covariance, time, lasting)
        elif state is not None and time - state.time <= patience:
            pairs[pair] = state
    known = {i: body for i, body in level.bodies.items() if any(i in pair for pair in pairs)}
    past = {
        child: [*level.past.get(child, []), state][-heritage:]
        for (parent, child), state in pairs.items()
        if parent == STATIC_BODY
    }
    unseen = {i: level.unseen[i] + 1 for i in known} | dict.fromkeys(bodies, 0)
    return PairLevel(
        pairs=pairs,
        bodies={**known, **present},
        past=past,
        unseen=unseen,
        ticks=level.ticks + 1,
    )


def predict_bodies(
    level: PairLevel, filters: JointFilters, period: float, least_probability: float
) -> list[BodyPrediction]:
    """Where each joint expects its child at the next tick, the likeliest first, for each child.

    The disconnected type says nothing of its own and is left out.
    """
    found: list[tuple[float, BodyPrediction]] = []
    for (parent_id, child_id), state in level.pairs.items():
        dt = (level.ticks + 1) * period - state.time
        for joint_type, probability in filters.probabilities(state).items():
            if joint_type == JointType.DISCONNECTED or probability < least_probability:
                continue
            pose = filters.predict(state, joint_type, dt)
            source = joint_type.value
            if parent_id != STATIC_BODY:
                pose = _on_parent(pose, level.bodies[parent_id].motion, period)
                source = f"{source} on {parent_id}"
            prediction = BodyPrediction(body_id=child_id, source=source, pose=pose)
            found.append((probability, prediction))
    found.sort(key=lambda item: (item[1].body_id, -item[0]))
    return [prediction for _, prediction in found]


def _on_parent(pose: PoseBelief, parent: MotionBelief, period: float) -> PoseBelief:
    """X_WB from X_PB, the parent going on at its velocity."""
    step = parent.V * period
    J = np.hstack([se3.adjoint(se3.exp(-step)), period * se3.right_jacobian(step)])
    X_WP, P = parent.X @ se3.exp(step), J @ parent.covariance @ J.T
    Ad = se3.adjoint(se3.inverse(pose.X))
    return PoseBelief(X=X_WP @ pose.X, covariance=pose.covariance + Ad @ P @ Ad.T)
