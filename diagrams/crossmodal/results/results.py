"""What an episode of the cross-modal application comes to."""

from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from crossmodal.diagrams.crossmodal.results.grasp_episode import grasp_episode, summarise_grasp
from crossmodal.diagrams.crossmodal.task import (
    can_be_judged,
    task_failure,
    task_phases,
    turning_time,
)
from crossmodal.diagrams.evaluation.estimates import Row, estimates_table, scalar, vector
from crossmodal.diagrams.evaluation.stream_faults import fault_events, fault_spans, health_rows
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, joint_episode
from crossmodal.diagrams.joints.joint_record import joint_rows, summarise_joint
from crossmodal.diagrams.joints.mechanics_record import mechanics_rows, summarise_mechanics
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.diagrams.run.scenario import Disturbances
from crossmodal.maths import se3
from crossmodal.systems.port_values import PoseBelief


def evaluate(record: EpisodeRecord) -> Results:
    """Compares an episode's beliefs with the truth."""
    # What only shows is imported here, so that it does not belong to `program_files`.
    from crossmodal.diagrams.crossmodal.results.frame_plots import draw_frames
    from crossmodal.diagrams.crossmodal.results.plots import (
        draw_configurations,
        draw_errors,
        draw_mechanics,
    )
    from crossmodal.diagrams.crossmodal.results.report import report

    episode = joint_episode(record)
    task, truth = record.scenario.task, episode.truth
    phases = task_phases(task, truth, record.events)
    exploration_end = turning_time(record.events) if task.return_to_start else None
    faults = fault_spans(record)
    grasp = grasp_episode(record)
    judged = can_be_judged(task, truth, record)
    return Results(
        failure=task_failure(task, truth, record.events, grasp.lost_at) if judged else None,
        judged=judged,
        estimates=estimates_table(
            {
                name: [
                    (tick.time, rows_of(episode, name, k)) for k, tick in enumerate(estimator.ticks)
                ]
                for name, estimator in record.estimators.items()
            }
        ),
        events=fault_events(faults),
        summary={
            "grasp": summarise_grasp(grasp),
            "stream_faults": [asdict(fault) for fault in faults],
            "modalities": {
                name: {"joints": [_summarise(episode, name, exploration_end)]}
                for name in episode.series
            },
            "phases": {
                name: {
                    "target": phase.target,
                    "reached": phase.reached,
                    "error": phase.reached - phase.target,
                }
                for name, phase in phases.items()
            },
        },
        plots={
            "errors.png": partial(draw_errors, episode),
            "frames.png": partial(draw_frames, episode),
            "configuration.png": partial(draw_configurations, episode),
            "forces.png": partial(draw_mechanics, episode),
        },
        report=partial(report, episode),
    )


def _summarise(episode: JointEpisode, name: str, exploration_end: float | None) -> dict[str, Any]:
    series, ticks = episode.series[name], episode.record.estimators[name].ticks
    summary = summarise_joint(series, episode.truth, exploration_end)
    return summary | {"mechanics": summarise_mechanics(ticks, series, episode.truth)}


def rows_of(episode: JointEpisode, name: str, k: int) -> list[Row]:
    """What an estimator believed at its tick k.

    Quantities: those of `joint_rows` and `mechanics_rows`; `grasp_probability` (one component per
    grasp type) and `feature_count`; `end_effector_position` (x, y, z), [m], and `hand_bending`, the
    bent hand's position (x, y, z) in the end-effector's frame, [m]; `camera_turn`, [rad], and
    `camera_shift`, [m], (x, y, z) since the camera was calibrated, in its frame; those of
    `health_rows`.
    """
    tick = episode.record.estimators[name].ticks[k]
    series, truth = episode.series[name], episode.truth
    joints = joint_rows(tick, series, k, truth) + mechanics_rows(tick, series, k, truth)
    camera = camera_rows(tick, episode.record.scenario.disturbances)
    return joints + _other_rows(tick) + camera + health_rows(tick)


def camera_rows(tick: Tick, disturbances: Disturbances) -> list[Row]:
    """Where the camera is, in the place that its calibration says, and where bumps have put it."""
    belief: PoseBelief | None = tick.values.get("camera_displacement_latest")
    if belief is None:
        return []
    turn, shift = se3.so3_log(belief.X[:3, :3].copy()), belief.X[:3, 3]
    true = disturbances.camera_displacement(tick.time)
    true_turn = se3.so3_log(true.rotation().matrix().copy())
    P = belief.covariance
    return [
        *vector("camera_turn", turn, P[:3, :3], true_turn),
        *vector("camera_shift", shift, P[3:, 3:], true.translation()),
    ]


def _other_rows(tick: Tick) -> list[Row]:
    rows: list[Row] = []
    if (grasp := tick.values.get("grasp_latest")) is not None:
        for grasp_type, probability in grasp.probabilities.items():
            rows.append(scalar("grasp_probability", probability, str(grasp_type)))
    features = tick.values.get("features_latest")
    if features is not None and len(features.ids):
        rows.append(scalar("feature_count", float(len(features.ids))))
    unknown = np.full(3, np.nan)
    for quantity, port in (
        ("end_effector_position", "end_effector_latest"),
        ("hand_bending", "hand_bending_latest"),
    ):
        belief: Any = tick.values.get(port)
        if belief is not None:
            R, P = belief.X[:3, :3], belief.covariance[3:6, 3:6]
            rows += vector(quantity, belief.X[:3, 3], R @ P @ R.T, unknown)
    return rows
