"""Compares the beliefs about a joint with the truth, tick by tick.

An axis and its configuration can be flipped together without changing the joint that they describe.
So estimates are first turned to the side of the true axis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crossmodal.diagrams.joints.joint_truth import Truth, truth_of_ticks
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.consistency import chi_square_quantile, normalised_squared_error
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.port_values import (
    HELD_BODY,
    MOVING_TYPES,
    STATIC_BODY,
    BodyMotions,
    JointBelief,
    JointBeliefs,
    JointModelBelief,
    JointType,
)

# Travel from which an object counts as moved, [m or rad], and speed of a moving one, [per s].
MOTION_START = {JointType.PRISMATIC: 0.005, JointType.REVOLUTE: 0.015, JointType.SCREW: 0.015}
MOVING_SPEED = {JointType.PRISMATIC: 0.002, JointType.REVOLUTE: 0.006, JointType.SCREW: 0.006}
_TWO_SIGMA = math.erf(math.sqrt(2.0))  # Probability of two deviations of one dimension.


def unit_of(joint_type: str | None) -> str:
    """The unit of a joint's configuration, in SI."""
    return "rad" if joint_type in (JointType.REVOLUTE, JointType.SCREW) else "m"


def drawn_in(joint_type: str | None) -> tuple[float, str]:
    """Factor from SI and unit in which people look at a joint's configuration."""
    return (100.0, "cm") if unit_of(joint_type) == "m" else (180.0 / math.pi, "deg")


def axis_sign(axis: Array, axis_true: Array) -> float:
    """-1 where the unit axis (3,) points against the true one, else 1."""
    return -1.0 if float(axis @ axis_true) < 0.0 else 1.0


def axis_angle_error(axis: Array, axis_true: Array) -> float:
    """Angle between two lines, [rad], from 0 to pi/2."""
    sine = float(np.linalg.norm(np.cross(axis, axis_true)))
    return float(np.arctan2(sine, abs(float(axis @ axis_true))))


def axis_distance_error(point: Array, point_true: Array, axis_true: Array) -> float:
    """Distance of a point (3,) from the true axis, [m]."""
    return float(np.linalg.norm(np.cross(point - point_true, axis_true)))


def axis_nees(axis: Array, covariance: Array, axis_true: Array) -> float:
    """Normalised squared error of a unit axis in its tangent plane; two degrees of freedom.

    Args:
        axis: Estimate (3,), on the side of the truth.
        covariance: (3, 3), of rank 2, [rad^2].
    """
    tangent = normal_basis(axis)
    error = tangent @ axis_true
    sine = float(np.linalg.norm(error))
    if sine > 1e-12:
        error = error * (axis_angle_error(axis, axis_true) / sine)
    return normalised_squared_error(error, tangent @ covariance @ tangent.T)


def select_joint(joints: JointBeliefs, parent_moves: bool = False) -> JointBelief | None:
    """The joint that an episode is about.

    To the environment, that is the joint of the body in the hand; vision alone does not know that
    body, and there it is the joint that has been observed for longest. Where the true joint's
    parent moves too (the lid of a box that slides), only a joint between two moving bodies will do.
    """
    candidates = [
        joint for joint in joints.joints if (joint.parent_id != STATIC_BODY) == parent_moves
    ]
    held = [joint for joint in candidates if is_held(joint)]
    return max(held or candidates, key=lambda joint: joint.updates, default=None)


def is_held(joint: JointBelief) -> bool:
    """Whether one of the joint's bodies is the one in the hand."""
    return HELD_BODY in (joint.parent_id, joint.child_id)


def in_world(joint: JointBelief, X_WP: Array) -> JointBelief:
    """The same belief with axes and points in W, the parent at X_WP (4, 4)."""
    R_WP = X_WP[:3, :3]
    models = {
        joint_type: replace(
            model,
            axis_P=R_WP @ model.axis_P,
            axis_covariance=R_WP @ model.axis_covariance @ R_WP.T,
            p_PA=R_WP @ model.p_PA + X_WP[:3, 3],
            p_PA_covariance=R_WP @ model.p_PA_covariance @ R_WP.T,
        )
        for joint_type, model in joint.models.items()
    }
    return replace(joint, models=models)


def joint_in_world(
    joints: JointBeliefs, bodies: BodyMotions, parent_moves: bool, *, at_reference: bool = False
) -> JointBelief | None:
    """The episode's joint in W, its parent where it is now or was before anything moved."""
    joint = select_joint(joints, parent_moves)
    if joint is None or joint.parent_id == STATIC_BODY:
        return joint
    parent = bodies.find(joint.parent_id)
    if parent is None:
        return None
    return in_world(joint, parent.X_WB_reference if at_reference else parent.motion.X)


@dataclass(kw_only=True)
class JointSeries:
    """One modality's belief about the joint against the truth, over T ticks.

    NaN stands for what a tick has no estimate of. Configurations and openings are in [m or rad].

    Attributes:
        times: (T,) [s].
        joints: The joint believed in at each tick, in W before anything moved; None where there is
            none.
        opening: True travel since the grasp (T,).
        configuration: Of the likeliest type (T,), on the true axis' side, counted from the grasp;
            that of a rigid one does not change.
        configuration_std: (T,)
        error: configuration - opening (T,), of the true type or a rigid joint.
        axis_error: Angle to the true axis (T,), [rad].
        axis_std: Root mean square of that angle as the filter expects it (T,), [rad].
        distance_error: Distance to the true axis (T,), [m]; of revolute joints.
        probability_true_type: (T,)
        type_is_right: (T,)
        configuration_nees: (T,), one degree of freedom.
        axis_nees: (T,), two degrees of freedom.
    """

    times: Array
    joints: list[JointBelief | None]
    opening: Array
    configuration: Array
    configuration_std: Array
    error: Array
    axis_error: Array
    axis_std: Array
    distance_error: Array
    probability_true_type: Array
    type_is_right: Mask
    configuration_nees: Array
    axis_nees: Array


def joints_of(tick: Tick) -> JointBeliefs:
    """What an estimator believed of the joints at a tick."""
    joints: JointBeliefs = tick.values.get("joints_latest", JointBeliefs())
    return joints


def bodies_of(tick: Tick) -> BodyMotions:
    """The bodies that those belong to."""
    bodies: BodyMotions = tick.values.get("body_motions_latest", BodyMotions())
    return bodies


def joint_series(ticks: Sequence[Tick], truth: Truth) -> JointSeries:
    """Evaluates every tick of an estimator."""
    times = np.array([tick.time for tick in ticks], dtype=float)
    opening = opening_at(times, truth)
    names = ("configuration", "configuration_std", "configuration_nees", "error", "axis_error",
             "axis_std", "axis_nees", "distance_error", "probability_true_type")  # fmt: skip
    columns = {name: np.full(len(ticks), np.nan) for name in names}
    joints = [
        joint_in_world(joints_of(tick), bodies_of(tick), truth.parent_moves, at_reference=True)
        for tick in ticks
    ]
    for k, joint in enumerate(joints):
        if joint is None:
            continue
        configuration = configuration_since_grasp(joint, truth, times[k])
        for name, value in _compare(joint, truth, opening[k], configuration).items():
            columns[name][k] = value
        if truth.joint_type is not None:
            columns["probability_true_type"][k] = joint.probabilities.get(truth.joint_type, 0.0)
    right = [joint is not None and joint.type == truth.joint_type for joint in joints]
    return JointSeries(
        times=times,
        joints=joints,
        opening=opening,
        type_is_right=np.array(right, dtype=bool),
        **columns,
    )


def opening_at(times: Array, truth: Truth) -> Array:
    """True travel since the grasp at the given instants."""
    if len(truth.times) == 0:
        return np.full(len(times), np.nan)
    return np.interp(times, truth.times, truth.opening())


def travel_at_reference(joint: JointBelief, time: float, truth: Truth) -> float:
    """True travel from the grasp to where a belief's configuration is zero, [m or rad].

    Where the belief does not say when that was, it is where the body was grasped last; without the
    truth it is zero.
    """
    if len(truth.times) == 0:
        return 0.0
    stood = time - joint.reference_age
    if math.isnan(stood):
        stood = truth.last_grasp(time)
    return float(opening_at(np.array([stood]), truth)[0])


def configuration_since_grasp(joint: JointBelief, truth: Truth, time: float) -> float:
    """Of the likeliest type at a time, on the true axis' side, counted from the grasp, [m or rad].

    That of a rigid joint does not change; of what is disconnected it is NaN. Which of two bodies
    that are only seen carries the other is a convention: `KinematicModel` goes by which was found
    first. Their configuration counts the way that fits the truth; so does every one where only the
    true position is known and not the axis.
    """
    start = travel_at_reference(joint, time, truth)
    if joint.type == JointType.RIGID:
        return start
    if joint.type == JointType.DISCONNECTED:
        return math.nan
    q = axis_sign(joint.model.axis_P, truth.axis_W) * float(joint.model.configuration[0])
    either = truth.parent_moves and not is_held(joint)
    if either or np.isnan(truth.axis_W).any():
        true = float(opening_at(np.array([time]), truth)[0]) - start
        q = min(q, -q, key=lambda value: abs(value - true))
    return start + q


def _compare(
    joint: JointBelief, truth: Truth, opening: float, configuration: float
) -> dict[str, float]:
    """The joint's figures by name."""
    if joint.type == JointType.RIGID:
        return {"configuration": configuration, "error": configuration - opening}
    if joint.type == JointType.DISCONNECTED:
        return {}
    model: JointModelBelief = joint.model
    sign = axis_sign(model.axis_P, truth.axis_W)
    variance = float(model.configuration_covariance[0, 0])
    compared = {
        "configuration": configuration,
        "configuration_std": float(np.sqrt(max(variance, 0.0))),
        "axis_error": axis_angle_error(model.axis_P, truth.axis_W),
        "axis_std": float(np.sqrt(max(np.trace(model.axis_covariance), 0.0))),
    }
    if joint.type == truth.joint_type:
        error = configuration - opening
        compared["error"] = error
        compared["configuration_nees"] = normalised_squared_error(
            np.array([error]), np.array([[variance]])
        )
        compared["axis_nees"] = axis_nees(sign * model.axis_P, model.axis_covariance, truth.axis_W)
        if truth.joint_type != JointType.PRISMATIC:
            compared["distance_error"] = axis_distance_error(
                model.p_PA, truth.point_W, truth.axis_W
            )
    return compared


def drawn_std(series: JointSeries, truth: Truth) -> Array:
    """Deviations of the configuration (T,): as reported, and of the claim that a joint is rigid.

    That has none of its own. How far the joint may have moved all the same is what the less likely
    types believe, weighted by their probabilities: the root mean square of the mixture of types
    about the configuration that does not change. Types whose unit is another one say nothing of it.
    """
    std = series.configuration_std.copy()
    types = [kind for kind in MOVING_TYPES if unit_of(kind) == unit_of(truth.joint_type)]
    for k, joint in enumerate(series.joints):
        if joint is None or joint.type != JointType.RIGID:
            continue
        p = np.array([joint.probabilities[kind] for kind in types])
        q = np.array([joint.models[kind].configuration[0] for kind in types])
        P = np.array([joint.models[kind].configuration_covariance[0, 0] for kind in types])
        std[k] = np.sqrt(p @ (q**2 + P) / (joint.probabilities[JointType.RIGID] + p.sum()))
    return std


def motion_start(truth: Truth) -> float | None:
    """The first instant at which the object has visibly moved since the grasp, [s]."""
    if truth.joint_type is None:
        return None
    moved = (np.abs(truth.opening()) >= MOTION_START[truth.joint_type]) & (
        truth.times >= truth.grasp_time
    )
    return float(truth.times[int(np.argmax(moved))]) if np.any(moved) else None


def moving_at(times: Array, truth: Truth) -> Mask:
    """Whether the object moves at the given instants, from the start of its motion on."""
    start = motion_start(truth)
    if start is None or truth.joint_type is None or len(truth.times) < 2:
        return np.zeros(len(times), dtype=bool)
    speed = np.abs(np.gradient(truth.configuration, truth.times))
    moving = np.interp(times, truth.times, speed) >= MOVING_SPEED[truth.joint_type]
    return moving & (times >= start)


def type_settled_at(series: JointSeries, truth: Truth) -> float | None:
    """Time of motion after which the likeliest type is the true one to the end, [s].

    Counted from the first 5 mm of travel (15 mrad of a revolute joint); None if it never settles.
    A modality that loses the joint for good is judged up to that moment.
    """
    start = motion_start(truth)
    last = last_seen(series)
    if start is None or last is None or not series.type_is_right[last]:
        return None
    wrong = np.flatnonzero(~series.type_is_right[: last + 1])
    settled = 0 if len(wrong) == 0 else int(wrong[-1]) + 1
    return max(0.0, float(series.times[settled]) - start)


def last_seen(series: JointSeries) -> int | None:
    """Index of the last tick with a belief about the joint."""
    seen = [k for k, joint in enumerate(series.joints) if joint is not None]
    return seen[-1] if seen else None


def turning_point(truth: Truth, latest: float = math.inf) -> int | None:
    """Index of the instant at which the joint is farthest from where it was grasped.

    Args:
        latest: After which it does not count, [s].
    """
    travel = np.where(truth.times <= latest, np.abs(truth.opening()), -np.inf)
    return int(np.argmax(travel)) if np.any(np.isfinite(travel)) else None


def error_at(series: JointSeries, time: float) -> tuple[float, float]:
    """Error of the configuration and of the axis at the tick nearest to `time`; NaN without one."""
    if len(series.times) == 0:
        return math.nan, math.nan
    k = int(np.argmin(np.abs(series.times - time)))
    return float(series.error[k]), float(series.axis_error[k])


def rms_while_moving(series: JointSeries, truth: Truth) -> float:
    """Root mean square error of the configuration over the ticks at which the object moves.

    Infinite where less than half of them have an estimate that can be compared: an estimator that
    loses the joint is not the better for it. NaN where nothing moves.
    """
    errors = series.error[moving_at(series.times, truth)]
    if len(errors) == 0:
        return math.nan
    known = errors[np.isfinite(errors)]
    if 2 * len(known) < len(errors):
        return math.inf
    return float(np.sqrt(np.mean(known**2)))


def inside_claim(series: JointSeries, k: int) -> tuple[bool | None, bool | None]:
    """Whether the errors of configuration and axis at a tick are within two reported deviations.

    Two sigma hold 95.4 % of a Gaussian: an ellipse of that content for the axis, which has two
    degrees of freedom. None where nothing is reported that can be compared.
    """
    bound = [chi_square_quantile(_TWO_SIGMA, degrees) for degrees in (1, 2)]
    values = (series.configuration_nees[k], series.axis_nees[k])
    inside = [None if math.isnan(v) else bool(v <= b) for v, b in zip(values, bound, strict=True)]
    return inside[0], inside[1]


@dataclass(frozen=True, kw_only=True)
class JointEpisode:
    """A record, the truth in it and every estimator's beliefs against that, evaluated once.

    Attributes:
        record: Of the episode.
        truth: For the evaluation alone.
        series: By estimator, of those that ticked.
    """

    record: EpisodeRecord
    truth: Truth
    series: dict[str, JointSeries]


def joint_episode(record: EpisodeRecord) -> JointEpisode:
    truth = truth_of_ticks(record.station)
    series = {
        name: joint_series(estimator.ticks, truth) for name, estimator in record.estimators.items()
    }
    return JointEpisode(record=record, truth=truth, series=series)
