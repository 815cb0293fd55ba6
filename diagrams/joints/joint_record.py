"""Turns an episode into a tidy table of estimates over time and a summary."""

import math
from typing import Any

import numpy as np
import pandas as pd

from diagrams.joints.joint_metrics import (
    JointSeries,
    axis_sign,
    joint_series,
    last_seen,
    moving_at,
    type_settled_at,
)
from diagrams.run.record import EpisodeResult, ModalityRecord, Phase, TickRecord, Truth
from maths import se3
from maths.arrays import Array
from maths.consistency import share_inside
from systems.port_values import BodyMotion, JointBelief, JointType

COLUMNS = ("time", "modality", "quantity", "component", "estimate", "std", "covariance", "truth")
_XYZ = ("x", "y", "z")
Row = tuple[float, str, str, str, float, float, list[float], float]


def estimates_table(result: EpisodeResult) -> pd.DataFrame:
    """All beliefs over time, one row per instant, modality, quantity and component.

    Columns: `time` [s], `modality`, `quantity`, `component`, `estimate`, its `std`, `covariance`
    (this component's row of the quantity's covariance) and `truth`. Quantities:

    - `configuration` [m or rad], since the grasp, and `configuration_rate` [per s];
    - `axis` (x, y, z) in the world, turned to the side of the true axis; `point` (x, y, z), [m],
      on a revolute axis, with the nearest true point;
    - `type_probability` (one component per joint type);
    - `body_position` (x, y, z), [m], and `body_rotation`, a rotation vector since the reference;
    - `grasp_probability` (one component per grasp type) and `feature_count`;
    - `end_effector_position` (x, y, z), [m], and `hand_bending`, the bent hand's position (x, y, z)
      in the end-effector's frame, [m].
    """
    rows: list[Row] = []
    for modality, record in result.modalities.items():
        series = joint_series(record.ticks, result.truth)
        for k, tick in enumerate(record.ticks):
            rows += _tick_rows(modality, tick, series, k, result.truth)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    return table.astype({"modality": "category", "quantity": "category", "component": "category"})


def _tick_rows(
    modality: str, tick: TickRecord, series: JointSeries, k: int, truth: Truth
) -> list[Row]:
    rows: list[Row] = []

    def scalar(
        quantity: str, component: str, value: float, std: float = math.nan, true: float = math.nan
    ) -> None:
        rows.append((tick.time, modality, quantity, component, value, std, [std**2], true))

    def vector(quantity: str, value: Array, covariance: Array, true: Array) -> None:
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        for i, component in enumerate(_XYZ):
            row = covariance[i].tolist()
            rows.append((tick.time, modality, quantity, component, value[i], std[i], row, true[i]))

    joint = series.joints[k]
    if joint is not None:
        _joint_rows(joint, series, k, truth, scalar, vector)
        body = tick.bodies.find(joint.child_id)
        if body is not None and len(truth.times):
            _body_rows(body, tick.time, truth, vector)
    if tick.grasp is not None:
        for grasp_type, probability in tick.grasp.probabilities.items():
            scalar("grasp_probability", str(grasp_type), probability)
    if tick.feature_count:
        scalar("feature_count", "", float(tick.feature_count))
    unknown = np.full(3, np.nan)
    for name, belief in (
        ("end_effector_position", tick.end_effector),
        ("hand_bending", tick.hand_bending),
    ):
        if belief is not None:
            R, P = belief.X[:3, :3], belief.covariance[3:6, 3:6]
            vector(name, belief.X[:3, 3], R @ P @ R.T, unknown)
    return rows


def _joint_rows(
    joint: JointBelief, series: JointSeries, k: int, truth: Truth, scalar: Any, vector: Any
) -> None:
    for joint_type, probability in joint.probabilities.items():
        scalar(
            "type_probability",
            str(joint_type),
            probability,
            true=float(joint_type == truth.joint_type),
        )
    if not np.isnan(series.configuration[k]):
        scalar(
            "configuration",
            "",
            series.configuration[k],
            series.configuration_std[k],
            series.opening[k],
        )
    if joint.type not in (JointType.PRISMATIC, JointType.REVOLUTE):
        return
    model = joint.model
    sign = axis_sign(model.axis_P, truth.axis_W)
    rate_std = float(np.sqrt(max(model.configuration_covariance[1, 1], 0.0)))
    scalar("configuration_rate", "", sign * float(model.configuration[1]), rate_std)
    vector("axis", sign * model.axis_P, model.axis_covariance, truth.axis_W)
    if joint.type == JointType.REVOLUTE:
        offset = model.p_PA - truth.point_W
        nearest = truth.point_W + truth.axis_W * float(offset @ truth.axis_W)
        vector("point", model.p_PA, model.p_PA_covariance, nearest)


def _body_rows(body: BodyMotion, time: float, truth: Truth, vector: Any) -> None:
    X_WB, X_WB_0 = body.motion.X, body.X_WB_reference
    now = min(int(np.searchsorted(truth.times, time - 1e-9)), len(truth.times) - 1)
    grasp = min(int(np.searchsorted(truth.times, truth.last_grasp(time))), len(truth.times) - 1)
    moved = truth.X_WB[now] @ se3.inverse(truth.X_WB[grasp])
    X_WB_true = moved @ X_WB_0
    R = X_WB[:3, :3]
    P = body.motion.covariance
    rotation = se3.so3_log(np.ascontiguousarray(R @ X_WB_0[:3, :3].T))
    rotation_true = se3.so3_log(np.ascontiguousarray(moved[:3, :3]))
    vector("body_position", X_WB[:3, 3], R @ P[3:6, 3:6] @ R.T, X_WB_true[:3, 3])
    vector("body_rotation", rotation, R @ P[:3, :3] @ R.T, rotation_true)


def summarise(result: EpisodeResult) -> dict[str, Any]:
    """The summary of an episode, all in SI and rad, ready for JSON: what is unknown is None."""
    phases = result.phases or {"exploration": exploration_phase(result)}
    summary = {
        "scenario": result.scenario.name,
        "seed": result.scenario.seed,
        "success": result.failure is None and not result.interrupted,
        "duration": result.duration,
        "wall_time": result.wall_time,
        "real_time_factor": result.duration / result.wall_time if result.wall_time > 0 else None,
        "peak_memory": result.peak_memory,
        "interrupted": result.interrupted,
        "failure": result.failure,
        "modalities": {
            name: _summarise_modality(record, result.truth)
            for name, record in result.modalities.items()
        },
        "phases": {
            name: {
                "target": phase.target,
                "reached": phase.reached,
                "error": phase.reached - phase.target,
            }
            for name, phase in phases.items()
        },
        "events": [{"time": event.time, "name": event.name} for event in result.events],
    }
    return without_nan(summary)


def exploration_phase(result: EpisodeResult) -> Phase:
    """The travel the task asks for and the travel at the end."""
    opening = result.truth.opening()
    reached = abs(float(opening[-1])) if len(opening) else math.nan
    return Phase(target=result.scenario.task.opening, reached=reached)


def _summarise_modality(record: ModalityRecord, truth: Truth) -> dict[str, Any]:
    series = joint_series(record.ticks, truth)
    ticks = np.asarray(record.tick_times, dtype=float)
    return {
        "joints": [_summarise_joint(series, truth)],
        "tick": {
            "median": float(np.median(ticks)) if len(ticks) else None,
            "p95": float(np.percentile(ticks, 95)) if len(ticks) else None,
        },
    }


def _summarise_joint(series: JointSeries, truth: Truth) -> dict[str, Any]:
    """The last belief about the joint against the truth at the end of the episode."""
    opening = truth.opening()
    end = float(opening[-1]) if len(opening) else math.nan
    summary: dict[str, Any] = {
        "name": truth.joint_name,
        "type_true": str(truth.joint_type),
        "type_estimated": None,
        "probability": None,
        "configuration_true": end,
        "configuration_estimated": None,
        "configuration_std": None,
        "configuration_error": None,
        "configuration_error_last_seen": None,
        "axis_true": truth.axis_W.tolist(),
        "axis_estimated": None,
        "axis_angle_error": None,
        "axis_angle_std": None,
        "axis_distance_error": None,
        "type_settled_at": type_settled_at(series, truth),
        "seen_until": None,
        "consistency": _consistency(series, truth),
    }
    last = last_seen(series)
    if last is None:
        return summary
    joint = series.joints[last]
    assert joint is not None
    comparable = not math.isnan(series.error[last])
    configuration = float(series.configuration[last])
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
    }
    if joint.type in (JointType.PRISMATIC, JointType.REVOLUTE):
        axis = joint.model.axis_P
        summary["axis_estimated"] = (axis_sign(axis, truth.axis_W) * axis).tolist()
    return summary


def _consistency(series: JointSeries, truth: Truth) -> dict[str, Any]:
    """Shares of the ticks in motion, with the right type, whose NEES is inside its 95 % bounds."""
    ticks = moving_at(series.times, truth) & series.type_is_right
    return {
        "configuration": share_inside(series.configuration_nees[ticks], 1),
        "axis": share_inside(series.axis_nees[ticks], 2),
        "ticks": int(np.sum(ticks)),
    }


def without_nan(value: Any) -> Any:
    """The same nested value with None for what JSON cannot hold: NaN and infinities."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
