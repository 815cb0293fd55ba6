"""What an episode of the cross-modal application comes to."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_episode import PITCH, empty_episode, synthetic_episode, without_truth

from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.results.report import final_beliefs
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.evaluation.estimates import COLUMNS
from crossmodal.diagrams.evaluation.metric_table import tidy_metrics
from crossmodal.diagrams.evaluation.run_writer import summarise
from crossmodal.diagrams.joints.joint_metrics import joint_episode
from crossmodal.diagrams.joints.joint_record import summarise_joint
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.systems.port_values import JointType


def joints_at_the_end(record: EpisodeRecord) -> dict[str, dict]:
    episode = joint_episode(record)
    return {name: summarise_joint(series, episode.truth) for name, series in episode.series.items()}


def test_the_phase_counts_what_the_joint_truly_travelled() -> None:
    phase = evaluate(synthetic_episode()).summary["phases"]["exploration"]
    assert_allclose([phase["target"], phase["reached"], phase["error"]], [0.2, 0.24, 0.04])


def test_an_episode_that_opened_too_little_failed() -> None:
    assert evaluate(synthetic_episode()).failure is None
    assert evaluate(synthetic_episode(duration=10.0)).failure == (
        "opened 12.0 cm of the 20 cm asked for when the time was over"
    )


def test_an_episode_that_hardly_began_has_an_empty_table() -> None:
    results = evaluate(empty_episode())
    assert len(results.estimates) == 0
    joint = results.summary["modalities"]["vision"]["joints"][0]
    assert joint["type_estimated"] is None
    assert results.report(summarise(APPLICATION, empty_episode(), results))


def test_the_table_is_tidy_and_agrees_with_the_summary() -> None:
    record = synthetic_episode(JointType.REVOLUTE)
    table = evaluate(record).estimates
    assert tuple(table.columns) == COLUMNS
    assert not table.duplicated(["time", "modality", "quantity", "component"]).any()
    q = table[(table.modality == "crossmodal") & (table.quantity == "configuration")]
    joint = joints_at_the_end(record)["crossmodal"]
    assert_allclose(q.iloc[-1].estimate, joint["configuration_estimated"])
    assert_allclose(q.iloc[-1].truth, joint["configuration_true"])
    axis = table[table.quantity == "axis"]
    assert_allclose(
        axis["std"] ** 2,
        [c["xyz".index(k)] for c, k in zip(axis.covariance, axis.component, strict=True)],
    )
    assert (axis[axis.component == "z"].estimate > 0.99).all()


def test_the_body_is_compared_at_its_own_instant() -> None:
    table = evaluate(synthetic_episode(JointType.REVOLUTE)).estimates
    for quantity in ("body_position", "body_rotation"):
        rows = table[(table.quantity == quantity) & (table.modality == "crossmodal")]
        assert len(rows) > 500
        assert_allclose(rows.estimate, rows.truth, atol=1e-9)


def test_type_probabilities_sum_to_one_and_their_truth_names_one_type() -> None:
    table = evaluate(synthetic_episode()).estimates
    rows = table[table.quantity == "type_probability"]
    sums = rows.groupby(["time", "modality"], observed=True)[["estimate", "truth"]].sum()
    assert_allclose(sums, 1.0)


@pytest.mark.parametrize("name", ["vision", "proprioception", "crossmodal"])
def test_every_modality_has_its_own_rows(name: str) -> None:
    record = synthetic_episode()
    table = evaluate(record).estimates
    rows = table[(table.modality == name) & (table.quantity == "configuration")]
    series = joint_episode(record).series[name]
    expected = series.configuration[~np.isnan(series.configuration)]
    assert_allclose(rows.estimate, expected)
    quantities = set(table[table.modality == name].quantity)
    assert ("feature_count" in quantities) == (name != "proprioception")
    assert ("grasp_probability" in quantities) == (name != "vision")


def test_without_the_truth_nothing_failed_and_no_error_is_claimed() -> None:
    record = without_truth(synthetic_episode())
    results = evaluate(record)
    assert results.failure is None
    assert results.estimates.truth.isna().all()
    summary = summarise(APPLICATION, record, results)
    json.dumps(summary, allow_nan=False)
    assert summary["phases"]["exploration"]["reached"] is None
    text = "\n".join(results.report(summary))
    assert "cross-modal:    prismatic" in text
    assert "Against the truth" not in text
    assert [name for name, draw in results.plots.items() if draw() is not None] == ["frames.png"]


def test_final_beliefs_are_a_table_for_people() -> None:
    record = synthetic_episode()
    table = final_beliefs(summarise(APPLICATION, record, evaluate(record)))
    assert list(table.index) == ["vision", "proprioception", "cross-modal"]
    error, unit = str(table.loc["cross-modal", "configuration error"]).split()
    assert unit == "mm"
    assert abs(float(error)) < 4.0


def test_nothing_that_is_printed_is_a_negative_zero() -> None:
    record = synthetic_episode()
    results = evaluate(record)
    summary = summarise(APPLICATION, record, results)
    for name, modality in summary["modalities"].items():
        joint = modality["joints"][0]
        joint["configuration_error"] = joint["axis_angle_error"] = -1e-9
        joint["configuration_estimated"] = -1e-7
        belief = record.estimators[name].ticks[-1].values["joints_latest"]
        for model in (model for one in belief.joints for model in one.models.values()):
            model.configuration[:] = -1e-9
            model.axis_P[:] = [-1.0, -1e-9, -1e-9]
    text = "\n".join(evaluate(record).report(summary))
    assert "axis (-1.000, +0.000, +0.000)" in text
    assert not re.search(r"-0\.?0*(?![.\d])", text), text
    assert "configuration error" in text


def test_the_report_says_what_the_tables_of_a_campaign_say() -> None:
    record = synthetic_episode(JointType.REVOLUTE)
    results = evaluate(record)
    text = "\n".join(results.report(summarise(APPLICATION, record, results)))
    assert "opening" not in text
    titles = {metric.name: metric.title for metric in APPLICATION.metrics}
    for name in ("configuration_error", "axis_angle_error", "axis_distance_error"):
        assert f"\n  {titles[name].removesuffix(' at the end')} " in text


def test_a_screws_pitch_is_in_summary_table_report_and_metrics() -> None:
    record = synthetic_episode(JointType.SCREW)
    results = evaluate(record)
    summary = summarise(APPLICATION, record, results)
    joint = summary["modalities"]["crossmodal"]["joints"][0]
    assert joint["type_true"] == joint["type_estimated"] == "screw"
    assert_allclose([joint["pitch_true"], joint["pitch"]], [PITCH, 1.03 * PITCH])
    assert_allclose([joint["pitch_error"], joint["pitch_std"]], [0.03 * PITCH, 0.0515 * PITCH])
    rows = results.estimates[results.estimates.quantity == "pitch"]
    last = rows[rows.modality == "crossmodal"].iloc[-1]
    assert_allclose([last.estimate, last["std"], last.truth], [1.03 * PITCH, 0.0515 * PITCH, PITCH])
    text = "\n".join(results.report(summary))
    assert "pitch 13.08 ± 0.65 mm/rad" in text
    (row,) = (line for line in text.splitlines() if line.startswith("  pitch "))
    assert row.split()[-4:] == ["13.08", "mm/rad", "12.70", "mm/rad"]
    table = tidy_metrics(APPLICATION, "press", [summary])
    errors = table[(table.metric == "pitch_error") & (table.modality == "crossmodal")]
    assert_allclose(errors.value, 0.03 * PITCH)
    assert set(errors.unit) == {"m/rad"}
    units = table[table.metric.isin(["configuration_error", "axis_distance_error"])]
    assert set(zip(units.metric, units.unit, strict=True)) == {
        ("configuration_error", "rad"),
        ("axis_distance_error", "m"),
    }


def test_what_does_not_screw_has_no_pitch() -> None:
    record = synthetic_episode(JointType.REVOLUTE)
    results = evaluate(record)
    summary = summarise(APPLICATION, record, results)
    assert summary["modalities"]["crossmodal"]["joints"][0]["pitch"] is None
    assert "pitch" not in "\n".join(results.report(summary))
    table = tidy_metrics(APPLICATION, "door", [summary])
    assert not table.metric.str.startswith("pitch").any()


def test_errors_have_two_digits_and_estimates_those_of_the_finest_claim() -> None:
    record = synthetic_episode()
    results = evaluate(record)
    summary = summarise(APPLICATION, record, results)
    joint = summary["modalities"]["crossmodal"]["joints"][0]
    joint |= {"configuration_error": 3.12e-5, "configuration_std": 2.6e-4}
    joint |= {"configuration_estimated": 0.244631}
    lines = [line.split("  ") for line in results.report(summary)]
    rows = {cells[1]: [cell.strip() for cell in cells[2:] if cell] for cells in lines if cells[1:]}
    assert rows["configuration"][2] == "24.463 cm"
    assert rows["configuration error"][2] == "0.031 mm"
