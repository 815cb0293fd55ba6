import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_episode import LIGHTS_OFF, empty_episode, synthetic_episode

from diagrams.joints.joint_record import COLUMNS, estimates_table, summarise, without_nan
from systems.port_values import JointType

JOINT_KEYS = {"name", "type_true", "type_estimated", "probability", "configuration_true",
              "configuration_estimated", "configuration_error", "axis_angle_error",
              "axis_distance_error", "type_settled_at"}  # fmt: skip


def test_the_summary_has_the_documented_keys_and_is_strict_json() -> None:
    summary = summarise(synthetic_episode())
    json.dumps(summary, allow_nan=False)
    assert {"scenario", "seed", "success", "duration", "wall_time", "real_time_factor", "failure",
            "modalities", "phases", "peak_memory"} <= set(summary)  # fmt: skip
    assert set(summary["modalities"]) == {"vision", "proprioception", "crossmodal"}
    for modality in summary["modalities"].values():
        assert set(modality["joints"][0]) >= JOINT_KEYS
        assert set(modality["tick"]) == {"median", "p95"}
        assert modality["tick"]["median"] <= modality["tick"]["p95"]
    assert_allclose(summary["real_time_factor"], 16.0 / 11.0)
    phase = summary["phases"]["exploration"]
    assert_allclose([phase["target"], phase["reached"], phase["error"]], [0.2, 0.24, 0.04])


def test_the_summary_compares_the_last_belief_with_the_end() -> None:
    summary = summarise(synthetic_episode())
    vision = summary["modalities"]["vision"]["joints"][0]
    cross = summary["modalities"]["crossmodal"]["joints"][0]
    assert_allclose(cross["configuration_true"], 0.24, atol=1e-9)
    assert abs(cross["configuration_error"]) < 0.004
    assert_allclose(
        cross["configuration_error"], cross["configuration_estimated"] - cross["configuration_true"]
    )
    assert cross["axis_distance_error"] is None
    assert_allclose(vision["seen_until"], LIGHTS_OFF, atol=0.07)
    assert vision["configuration_error"] < -0.12
    assert abs(vision["configuration_error_last_seen"]) < 0.006
    assert 0.7 < cross["type_settled_at"] < 0.9


def test_the_table_is_tidy_and_agrees_with_the_summary() -> None:
    result = synthetic_episode(JointType.REVOLUTE)
    table = estimates_table(result)
    assert tuple(table.columns) == COLUMNS
    assert not table.duplicated(["time", "modality", "quantity", "component"]).any()
    q = table[(table.modality == "crossmodal") & (table.quantity == "configuration")]
    joint = summarise(result)["modalities"]["crossmodal"]["joints"][0]
    assert_allclose(q.iloc[-1].estimate, joint["configuration_estimated"])
    assert_allclose(q.iloc[-1].truth, joint["configuration_true"])
    axis = table[table.quantity == "axis"]
    assert_allclose(
        axis["std"] ** 2,
        [c["xyz".index(k)] for c, k in zip(axis.covariance, axis.component, strict=True)],
    )
    assert (axis[axis.component == "z"].estimate > 0.99).all()


def test_the_body_is_compared_at_its_own_instant() -> None:
    table = estimates_table(synthetic_episode(JointType.REVOLUTE))
    for quantity in ("body_position", "body_rotation"):
        rows = table[(table.quantity == quantity) & (table.modality == "crossmodal")]
        assert len(rows) > 500
        assert_allclose(rows.estimate, rows.truth, atol=1e-9)


def test_type_probabilities_sum_to_one_and_their_truth_names_one_type() -> None:
    table = estimates_table(synthetic_episode())
    rows = table[table.quantity == "type_probability"]
    sums = rows.groupby(["time", "modality"], observed=True)[["estimate", "truth"]].sum()
    assert_allclose(sums, 1.0)


def test_an_episode_that_hardly_began_still_has_a_summary() -> None:
    summary = summarise(empty_episode())
    json.dumps(summary, allow_nan=False)
    assert summary["success"] is False
    assert summary["modalities"]["vision"]["joints"][0]["type_estimated"] is None
    assert len(estimates_table(empty_episode())) == 0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.float64("nan")])
def test_what_json_cannot_hold_becomes_null(value: float) -> None:
    assert without_nan({"a": [value, 1.0], "b": (np.float64(2.0),)}) == {
        "a": [None, 1.0],
        "b": [2.0],
    }
