"""A joint's belief as rows of the table and as a part of the summary."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from synthetic_episode import LIGHTS_OFF, empty_episode, synthetic_episode, without_truth

from crossmodal.diagrams.joints.joint_metrics import bodies_of, joint_episode, joint_series
from crossmodal.diagrams.joints.joint_record import joint_rows, summarise_joint
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.systems.port_values import BodyMotions, JointType

JOINT_KEYS = {"name", "type_true", "type_estimated", "probability", "configuration_true",
              "configuration_estimated", "configuration_error", "axis_angle_error",
              "axis_distance_error", "type_settled_at"}  # fmt: skip


def joints_at_the_end(
    record: EpisodeRecord, exploration_end: float | None = None
) -> dict[str, dict[str, Any]]:
    episode = joint_episode(record)
    return {
        name: summarise_joint(series, episode.truth, exploration_end)
        for name, series in episode.series.items()
    }


def test_only_an_episode_that_turns_back_has_figures_of_its_turning_point() -> None:
    for exploration_end in (None, 5.0):
        for joint in joints_at_the_end(synthetic_episode(), exploration_end).values():
            has = [key.endswith("_at_turn") for key in joint]
            assert sum(has) == (0 if exploration_end is None else 2)


def test_the_summary_compares_the_last_belief_with_the_end() -> None:
    joints = joints_at_the_end(synthetic_episode())
    vision, cross = joints["vision"], joints["crossmodal"]
    assert_allclose(cross["configuration_true"], 0.24, atol=1e-9)
    assert abs(cross["configuration_error"]) < 0.004
    assert_allclose(
        cross["configuration_error"], cross["configuration_estimated"] - cross["configuration_true"]
    )
    assert np.isnan(cross["axis_distance_error"])
    assert_allclose(vision["seen_until"], LIGHTS_OFF, atol=0.07)
    assert vision["configuration_error"] < -0.12
    assert abs(vision["configuration_error_last_seen"]) < 0.006
    assert 0.7 < cross["type_settled_at"] < 0.9


def test_the_summary_has_the_documented_keys_whatever_was_seen() -> None:
    for record in (synthetic_episode(), empty_episode(), without_truth(synthetic_episode())):
        for joint in joints_at_the_end(record).values():
            assert set(joint) >= JOINT_KEYS


def test_a_modality_that_lost_the_joint_claims_nothing_at_the_end() -> None:
    joints = joints_at_the_end(synthetic_episode())
    assert joints["vision"]["configuration_inside_two_sigma"] is None
    assert joints["crossmodal"]["configuration_inside_two_sigma"] is True


def test_of_what_nobody_knows_no_error_is_claimed() -> None:
    for joint in joints_at_the_end(without_truth(synthetic_episode()), 5.0).values():
        assert joint["type_true"] is None
        assert joint["type_estimated"] == "prismatic"
        assert np.isfinite(joint["configuration_estimated"])
        for key in ("configuration_error", "axis_angle_error", "configuration_error_at_turn",
                    "configuration_inside_two_sigma", "configuration_rms_moving"):  # fmt: skip
            assert joint[key] is None or np.isnan(joint[key]), key


def test_without_the_truth_rows_hold_the_estimates_alone() -> None:
    episode = joint_episode(without_truth(synthetic_episode()))
    ticks = episode.record.estimators["crossmodal"].ticks
    rows = joint_rows(ticks[-1], episode.series["crossmodal"], len(ticks) - 1, episode.truth)
    assert {row[0] for row in rows} >= {"type_probability", "configuration", "axis"}
    assert np.all(np.isnan([row[-1] for row in rows]))


def test_a_configuration_has_a_truth_where_both_have_the_same_unit() -> None:
    record = synthetic_episode()
    ticks, k = record.estimators["crossmodal"].ticks, -1
    believed = joint_episode(record).series["crossmodal"].joints[k]
    for of_belief, of_truth, has in (
        (JointType.PRISMATIC, JointType.PRISMATIC, True),
        (JointType.PRISMATIC, JointType.REVOLUTE, False),
        (JointType.REVOLUTE, JointType.SCREW, True),
    ):
        truth = replace(joint_episode(record).truth, type=str(of_truth))
        series = joint_series(ticks, truth)
        series.joints[k] = replace(
            believed,
            probabilities={one: float(one == of_belief) for one in JointType},
            models={**believed.models, of_belief: believed.models[JointType.PRISMATIC]},
        )
        rows = joint_rows(ticks[k], series, k, truth)
        (true,) = (row[-1] for row in rows if row[0] == "configuration")
        assert np.isfinite(true) == has


def test_a_body_counts_from_when_it_stood_at_its_own_reference() -> None:
    """What only the eye follows was seen to rest before the hand closed, or after."""
    episode = joint_episode(synthetic_episode())
    ticks, truth = episode.record.estimators["crossmodal"].ticks, episode.truth
    k = len(ticks) - 1
    bodies = bodies_of(ticks[k]).bodies
    for age in (1.0, 5.0):
        stood = int(np.searchsorted(truth.times, ticks[k].time - age - 1e-9))
        X_WB_0 = np.eye(4)
        X = truth.X_WB[k] @ np.linalg.inv(truth.X_WB[stood]) @ X_WB_0
        seen = [
            replace(
                body, motion=replace(body.motion, X=X), X_WB_reference=X_WB_0, reference_age=age
            )
            for body in bodies
        ]
        values = {**ticks[k].values, "body_motions_latest": BodyMotions(bodies=seen)}
        rows = joint_rows(replace(ticks[k], values=values), episode.series["crossmodal"], k, truth)
        position = [row for row in rows if row[0] == "body_position"]
        assert len(position) == 3
        assert_allclose([row[2] for row in position], [row[-1] for row in position], atol=1e-9)
