"""The articulated object that joint filters perceive, tick by tick, without any truth."""

import math
from dataclasses import replace

import numpy as np

from crossmodal.diagrams.joints.joint_metrics import bodies_of, joints_of
from crossmodal.diagrams.joints.mechanics_record import CLAIMED
from crossmodal.diagrams.run.record import Tick
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
    screw_of,
)
from crossmodal.systems.port_values import (
    HELD_BODY,
    MOVING_TYPES,
    STATIC_BODY,
    BodyMotion,
    JointBelief,
    JointMechanicsBelief,
    JointMechanicsBeliefs,
    JointType,
    LimitBelief,
)

ROOT = "environment"


def body_name(body_id: int) -> str:
    """What a body's link is called."""
    return {STATIC_BODY: ROOT, HELD_BODY: "held_body"}.get(body_id, f"body_{body_id}")


def perceived_object(before: ArticulatedObject | None, tick: Tick) -> ArticulatedObject | None:
    """The object as an estimator perceives it at a tick.

    It is the body in the hand, where a joint moves it, and else all bodies that a joint moves,
    with what these are joined to. A body that is not seen is where it would be by its joint. While
    nothing is known of any joint, the object stays as it was.

    Args:
        before: That of the last tick; None at the first.
        tick: The estimator's `joints_latest`, `body_motions_latest` and, where it feels forces,
            `joint_mechanics_latest`.
    """
    bodies = {body.body_id: body for body in bodies_of(tick).bodies}
    joined = _chosen(joints_of(tick).joints, set(bodies))
    if not joined:
        return before
    earlier = {} if before is None else {joint.name: joint for joint in before.joints}
    shapes = {} if before is None else {body.name: body for body in before.bodies}
    found = ArticulatedObject(root=ROOT, time=tick.time)
    poses = {STATIC_BODY: np.eye(4)}
    for belief in joined:
        child = belief.child_id
        X_WP = poses[belief.parent_id]
        name = f"{body_name(belief.parent_id)}_to_{body_name(child)}"
        joint = _joint(belief, bodies[child], X_WP, earlier.get(name), name)
        felt = _mechanics(tick, belief)
        joint = _ranged(joint, felt, earlier.get(name))
        found.joints.append(_with_friction(_oriented(joint), felt))
        poses[child] = X_WP @ joint.pose(0.0 if math.isnan(joint.q) else joint.q)
        found.bodies.append(_body(bodies[child], poses[child], shapes.get(body_name(child))))
    return found


def _chosen(joints: list[JointBelief], known: set[int]) -> list[JointBelief]:
    """One joint for each body of the object, parents first.

    A body is joined to the environment unless it is believed to be disconnected from it, and then
    to the moving body that it is most probably connected to.
    """
    best: dict[int, JointBelief] = {}
    for joint in sorted(joints, key=lambda joint: joint.parent_id):
        loose = joint.probabilities[JointType.DISCONNECTED]
        other = best.get(joint.child_id)
        settled = other is not None and (
            other.parent_id == STATIC_BODY or other.probabilities[JointType.DISCONNECTED] <= loose
        )
        if joint.type != JointType.DISCONNECTED and joint.child_id in known and not settled:
            best[joint.child_id] = joint
    moving = {child for child, joint in best.items() if joint.type in MOVING_TYPES}
    wanted = {HELD_BODY} if HELD_BODY in moving else moving | {HELD_BODY}
    chosen: dict[int, JointBelief] = {}
    for child, joint in best.items():
        if child in wanted:
            chain = [joint]
            while chain[-1].parent_id in best:
                chain.append(best[chain[-1].parent_id])
            if chain[-1].parent_id == STATIC_BODY:
                chosen |= {
                    one.child_id: one for one in reversed(chain) if one.child_id not in chosen
                }
    return list(chosen.values())


def _joint(
    belief: JointBelief, body: BodyMotion, X_WP: Array, before: ObjectJoint | None, name: str
) -> ObjectJoint:
    """The joint without its range; a body that is not seen leaves its path where it was."""
    model, moves = belief.model, belief.type in MOVING_TYPES
    joint = ObjectJoint(
        name=name,
        parent=body_name(belief.parent_id),
        child=body_name(belief.child_id),
        type=str(belief.type),
        probability=float(belief.probabilities[belief.type]),
        hinge_probability=float(belief.hinge_probability()),
        updates=int(belief.updates),
        X_PB_zero=se3.inverse(X_WP) @ body.motion.X,
    )
    stays = None  # Where the path was.
    if before is not None and before.type == joint.type and not body.is_seen:
        stays = before.X_PB_zero
    if not moves:
        return joint if stays is None else replace(joint, X_PB_zero=stays)
    q, S_P = float(model.configuration[0]), screw_of(belief.type, model)
    X_PB_zero = se3.exp(-S_P * q) @ joint.X_PB_zero if stays is None else stays
    return replace(
        joint,
        S_P=S_P,
        X_PB_zero=X_PB_zero,
        q=q,
        q_deviation=_deviation(model.configuration_covariance[0, 0]),
        axis_deviation=_deviation(np.trace(model.axis_covariance)),
        position_deviation=_deviation(np.trace(model.p_PA_covariance)),
        pitch=float(model.pitch),
        pitch_deviation=_deviation(model.pitch_variance),
    )


def _deviation(variance: float) -> float:
    return float(np.sqrt(max(float(variance), 0.0))) if np.isfinite(variance) else math.nan


def _mechanics(tick: Tick, belief: JointBelief) -> JointMechanicsBelief | None:
    felt: JointMechanicsBeliefs = tick.values.get("joint_mechanics_latest", JointMechanicsBeliefs())
    pair = (belief.parent_id, belief.child_id)
    return next(
        (one.models.get(belief.type) for one in felt.joints
         if (one.parent_id, one.child_id) == pair), None
    )  # fmt: skip


def _ranged(
    joint: ObjectJoint, felt: JointMechanicsBelief | None, before: ObjectJoint | None
) -> ObjectJoint:
    """The joint with its range: end stops that were reached, and else how far it was seen to go."""
    if not joint.moves:
        return joint
    if felt is not None:
        low, high = (_limit(limit) for limit in (felt.lower, felt.upper))
    else:
        low = high = (joint.q, joint.q_deviation, False)
    seen = [(0.0, math.nan), (joint.q, joint.q_deviation)]  # Zero is so by definition.
    if felt is None and before is not None and before.type == joint.type:
        side = 1.0 if float(before.axis_P @ joint.axis_P) >= 0.0 else -1.0
        seen.append((side * before.lower, before.lower_deviation))
        seen.append((side * before.upper, before.upper_deviation))

    def q(place: tuple[float, float]) -> float:
        return place[0]

    lower = min((place for place in (low[:2], *seen) if not math.isnan(place[0])), key=q)
    upper = max((place for place in (high[:2], *seen) if not math.isnan(place[0])), key=q)
    return replace(
        joint,
        lower=lower[0],
        upper=upper[0],
        lower_deviation=lower[1],
        upper_deviation=upper[1],
        lower_is_stop=low[2],
        upper_is_stop=high[2],
    )


def _limit(limit: LimitBelief) -> tuple[float, float, bool]:
    """Place, standard deviation, and whether it is an end stop."""
    if limit.probability > CLAIMED:
        return limit.position, _deviation(limit.variance), True
    return limit.bound, _deviation(limit.bound_variance), False


def _oriented(joint: ObjectJoint) -> ObjectJoint:
    """The joint with its axis turned so that it goes farther to the positive side."""
    if not joint.moves or -joint.lower <= joint.upper:
        return joint
    return replace(
        joint,
        S_P=-joint.S_P,
        q=-joint.q,
        lower=-joint.upper,
        upper=-joint.lower,
        lower_deviation=joint.upper_deviation,
        upper_deviation=joint.lower_deviation,
        lower_is_stop=joint.upper_is_stop,
        upper_is_stop=joint.lower_is_stop,
    )


def _with_friction(joint: ObjectJoint, felt: JointMechanicsBelief | None) -> ObjectJoint:
    if felt is None or not felt.samples:
        return joint
    deviations = [_deviation(variance) for variance in np.diag(felt.friction_covariance)]
    return replace(
        joint,
        friction=float(felt.friction[0]),
        friction_deviation=deviations[0],
        damping=float(felt.friction[1]),
        damping_deviation=deviations[1],
    )


def _body(body: BodyMotion, X_WB: Array, before: ObjectBody | None) -> ObjectBody:
    """The body with the extents of its landmarks; those that it had before while it has none."""
    name = body_name(body.body_id)
    made = ObjectBody(name=name, frame=f"{name}_frame", X_WB=X_WB)
    if len(body.p_BF):
        return replace(made, low=body.p_BF.min(axis=0), high=body.p_BF.max(axis=0))
    return made if before is None else replace(made, low=before.low, high=before.high)
