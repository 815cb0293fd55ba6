"""The joint of an episode as rows of the table of estimates and as a part of the summary."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from crossmodal.diagrams.evaluation.estimates import Row, scalar, vector
from crossmodal.diagrams.joints.joint_metrics import (
    JointSeries,
    axis_sign,
    bodies_of,
    error_at,
    inside_claim,
    last_seen,
    moving_at,
    rms_while_moving,
    turning_point,
    type_settled_at,
    unit_of,
)
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.record import Tick
from crossmodal.maths import se3
from crossmodal.maths.consistency import share_above, share_inside
from crossmodal.systems.port_values import MOVING_TYPES, BodyMotion, JointBelief, JointType

# What a summary says of a joint where one was believed in, else null.
_OF_A_BELIEF = (
    "type_estimated", "probability", "configuration_estimated", "configuration_std",
    "configuration_error", "configuration_error_last_seen", "configuration_inside_two_sigma",
    "axis_estimated", "axis_angle_error", "axis_angle_std", "axis_inside_two_sigma",
    "axis_distance_error", "pitch", "pitch_std", "pitch_error", "seen_until", "fit",
)  # fmt: skip
_STILL_SEEN = 0.5  # An estimator that lost the joint longer ago claims nothing at the end, [s].


def joint_rows(tick: Tick, series: JointSeries, k: int, truth: Truth) -> list[Row]:
    """What an estimator believed of the joint at its tick k, and of the body that moves.

    Quantities:

    - `configuration` [m or rad], since the grasp, and `configuration_rate` [per s]; the truth is
      NaN while the likeliest type has another unit than the true one;
    - `axis` (x, y, z) in the world, turned to the side of the true axis; `point` (x, y, z), [m],
      on the axis of a revolute joint or a screw, with the nearest true point;
    - `pitch` of a screw, [m/rad];
    - `type_probability` (one component per joint type);
    - `joint_fit` (components as `JointFit` has them, and `skipped`, how many measurements were);
    - `body_position` (x, y, z), [m], and `body_rotation`, a rotation vector since the reference.
    """
    joint = series.joints[k]
    if joint is None:
        return []
    rows = _belief_rows(joint, series, k, truth)
    body = bodies_of(tick).find(joint.child_id)
    if body is not None and len(truth.times):
        rows += _body_rows(body, tick.time, truth)
    return rows


def _belief_rows(joint: JointBelief, series: JointSeries, k: int, truth: Truth) -> list[Row]:
    rows: list[Row] = []
    for joint_type, probability in joint.probabilities.items():
        known = truth.joint_type is not None
        is_true = float(joint_type == truth.joint_type) if known else math.nan
        rows.append(scalar("type_probability", probability, str(joint_type), true=is_true))
    rows += _fit_rows(joint)
    if not np.isnan(series.configuration[k]):
        same = joint.type == JointType.RIGID or unit_of(joint.type) == unit_of(truth.joint_type)
        std, true = series.configuration_std[k], series.opening[k] if same else math.nan
        rows.append(scalar("configuration", series.configuration[k], std=std, true=true))
    if joint.type not in MOVING_TYPES:
        return rows
    model = joint.model
    sign = axis_sign(model.axis_P, truth.axis_W)
    rate_std = float(np.sqrt(max(model.configuration_covariance[1, 1], 0.0)))
    rate = sign * float(model.configuration[1])
    rows.append(scalar("configuration_rate", rate, std=rate_std))
    rows += vector("axis", sign * model.axis_P, model.axis_covariance, truth.axis_W)
    if joint.type != JointType.PRISMATIC:
        offset = model.p_PA - truth.point_W
        nearest = truth.point_W + truth.axis_W * float(offset @ truth.axis_W)
        rows += vector("point", model.p_PA, model.p_PA_covariance, nearest)
    if joint.type == JointType.SCREW:
        pitch_std = float(np.sqrt(model.pitch_variance))
        rows.append(scalar("pitch", model.pitch, std=pitch_std, true=truth.pitch))
    return rows


def _fit_rows(joint: JointBelief) -> list[Row]:
    if joint.fit is None:
        return []
    numbers = {**asdict(joint.fit), "skipped": sum(joint.skipped.values())}
    low, high = numbers.pop("bounds")
    rotation, translation = numbers.pop("noise_scale")
    numbers |= {"chi_square_low": low, "chi_square_high": high}
    numbers |= {"noise_scale_rotation": rotation, "noise_scale_translation": translation}
    return [scalar("joint_fit", float(value), name) for name, value in numbers.items()]


def _body_rows(body: BodyMotion, time: float, truth: Truth) -> list[Row]:
    X_WB, X_WB_0 = body.motion.X, body.X_WB_reference
    now = min(int(np.searchsorted(truth.times, time - 1e-9)), len(truth.times) - 1)
    # What the hand takes counts from the grasp, what only the eye follows from when it last rested.
    stood = truth.last_grasp(time) if math.isnan(body.reference_age) else time - body.reference_age
    start = min(int(np.searchsorted(truth.times, stood - 1e-9)), len(truth.times) - 1)
    moved = truth.X_WB[now] @ se3.inverse(truth.X_WB[start])
    X_WB_true = moved @ X_WB_0
    R = X_WB[:3, :3]
    P = body.motion.covariance
    rotation = se3.so3_log(np.ascontiguousarray(R @ X_WB_0[:3, :3].T))
    rotation_true = se3.so3_log(np.ascontiguousarray(moved[:3, :3]))
    return [
        *vector("body_position", X_WB[:3, 3], R @ P[3:6, 3:6] @ R.T, X_WB_true[:3, 3]),
        *vector("body_rotation", rotation, R @ P[:3, :3] @ R.T, rotation_true),
    ]


def summarise_joint(
    series: JointSeries, truth: Truth, exploration_end: float | None = None
) -> dict[str, Any]:
    """The last belief about the joint against the truth at the end of the episode, and on the way.

    Args:
        series: Of one estimator.
        truth: Over the episode.
        exploration_end: Up to when the joint's turning point is looked for, [s]; None where the
            robot is not to turn back, so that the summary has nothing of such a point.
    """
    opening = truth.opening()
    end = float(opening[-1]) if len(opening) else math.nan
    summary: dict[str, Any] = {
        "name": truth.name,
        "type_true": None if truth.joint_type is None else str(truth.joint_type),
        "configuration_true": end,
        "axis_true": truth.axis_W.tolist(),
        "pitch_true": None if math.isnan(truth.pitch) else truth.pitch,
        "type_settled_at": type_settled_at(series, truth),
        "consistency": _consistency(series, truth),
        "configuration_rms_moving": rms_while_moving(series, truth),
        **dict.fromkeys(_OF_A_BELIEF),
        "skipped": {},
    }
    if exploration_end is not None:
        turn = turning_point(truth, exploration_end)
        errors = (None, None) if turn is None else error_at(series, float(truth.times[turn]))
        summary["configuration_error_at_turn"], summary["axis_angle_error_at_turn"] = errors
    last = last_seen(series)
    if last is None:
        return summary
    joint = series.joints[last]
    assert joint is not None
    configuration = float(series.configuration[last])
    comparable = not math.isnan(series.error[last])
    summary |= {
        "type_estimated": str(joint.type),
        "probability": float(joint.probabilities[joint.type]),
        "configuration_estimated": configuration,
        "configuration_std": float(series.configuration_std[last]),
        "configuration_error": configuration - end if comparable else None,
        "configuration_error_last_seen": float(series.error[last]),
        "axis_angle_error": float(series.axis_error[last]),
        "axis_angle_std": float(series.axis_std[last]),
        "axis_distance_error": float(series.distance_error[last]),
        "seen_until": float(series.times[last]),
        "fit": None if joint.fit is None else asdict(joint.fit),
        "skipped": {str(reason): count for reason, count in joint.skipped.items()},
    }
    if series.times[-1] - series.times[last] <= _STILL_SEEN:
        inside = inside_claim(series, last)
        summary["configuration_inside_two_sigma"], summary["axis_inside_two_sigma"] = inside
    if joint.type in MOVING_TYPES:
        axis = joint.model.axis_P
        summary["axis_estimated"] = (axis_sign(axis, truth.axis_W) * axis).tolist()
    if joint.type == JointType.SCREW:
        summary["pitch"] = float(joint.model.pitch)
        summary["pitch_std"] = float(np.sqrt(joint.model.pitch_variance))
        if not math.isnan(truth.pitch):
            summary["pitch_error"] = float(joint.model.pitch) - truth.pitch
    return summary


def _consistency(series: JointSeries, truth: Truth) -> dict[str, Any]:
    """Shares of the ticks in motion, with the right type, whose NEES is inside its 95 % bounds.

    Above them (`_too_sure`) the error is too large for the reported covariance, below too small.
    """
    ticks = moving_at(series.times, truth) & series.type_is_right
    configuration, axis = series.configuration_nees[ticks], series.axis_nees[ticks]
    if np.isnan(truth.axis_W).any():
        axis = axis[:0]
    return {
        "configuration": share_inside(configuration, 1),
        "axis": share_inside(axis, 2),
        "configuration_too_sure": share_above(configuration, 1),
        "axis_too_sure": share_above(axis, 2),
        "ticks": int(np.sum(ticks)),
    }
