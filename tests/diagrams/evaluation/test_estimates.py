"""A table of estimates over time, and what an episode comes to by it alone."""

import json
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.diagrams.evaluation.estimates import (
    COLUMNS,
    EvaluationWarning,
    Row,
    error_metrics,
    estimates_table,
    evaluate_rows,
    scalar,
    vector,
)
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.folder.run_folder import without_nan
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Tick
from crossmodal.diagrams.run.scenario import Scenario

UNITS = {"angle": "rad", "place": "m", "count": ""}
ERRORS = {"left": [0.1, -0.3, 0.1], "right": [0.0, 0.0, 0.2]}


def rows(estimator: str, tick: Tick, station: Tick) -> list[Row]:
    true = station.values.get("cheat_angle", np.nan)
    place = np.array([1.0, 2.0, 3.0])
    true_place = np.full(3, np.nan) if np.isnan(true) else place
    return [
        scalar("angle", tick.values["angle_latest"], std=0.1, true=true),
        *vector("place", place, np.diag([0.01, 0.04, 0.09]), true_place),
        scalar("count", 3.0),
    ]


def record(*, with_truth: bool = True) -> EpisodeRecord:
    """Two estimators of an angle that is 1, 2 and 3 rad."""
    truth = [{"cheat_angle": k + 1.0} if with_truth else {} for k in range(3)]
    return EpisodeRecord(
        scenario=Scenario(name="a"),
        calibration=Calibration(),
        station=[Tick(time=float(k), values=values) for k, values in enumerate(truth)],
        estimators={
            name: EstimatorRecord(
                ticks=[
                    Tick(time=float(k), values={"angle_latest": k + 1.0 + error})
                    for k, error in enumerate(errors)
                ]
            )
            for name, errors in ERRORS.items()
        },
        duration=2.0,
        wall_time=1.0,
    )


def errors_of(results: Results, name: str, quantity: str) -> dict[str, Any]:
    return dict(results.summary["modalities"][name]["quantities"][quantity])


def test_a_vector_is_three_rows_with_their_rows_of_the_covariance() -> None:
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 16.0]])
    found = vector("p", np.array([1.0, 2.0, 3.0]), covariance, np.zeros(3))
    assert [row[1] for row in found] == ["x", "y", "z"]
    assert [row[3] for row in found] == [2.0, 3.0, 4.0]
    assert_allclose([row[4] for row in found], covariance)


def test_the_table_is_tidy_and_every_estimator_has_its_own_rows() -> None:
    table = evaluate_rows(record(), rows, UNITS).estimates
    assert tuple(table.columns) == COLUMNS
    assert not table.duplicated(["time", "modality", "quantity", "component"]).any()
    for name, errors in ERRORS.items():
        angle = table[(table.modality == name) & (table.quantity == "angle")]
        assert_allclose(angle.estimate - angle.truth, errors, atol=1e-12)


def test_an_empty_table_has_its_columns() -> None:
    table = estimates_table({"left": []})
    assert len(table) == 0
    assert tuple(table.columns) == COLUMNS


def test_errors_are_those_at_the_end_over_time_and_against_the_claim() -> None:
    results = evaluate_rows(record(), rows, UNITS)
    left = errors_of(results, "left", "angle")
    assert_allclose(left["final_error"], 0.1)
    assert_allclose(left["rms_error"], np.sqrt((0.01 + 0.09 + 0.01) / 3))
    assert_allclose(left["inside_two_sigma"], 2 / 3)
    assert left["unit"] == "rad"
    assert_allclose(errors_of(results, "left", "place_y")["inside_two_sigma"], 1.0)
    assert errors_of(results, "left", "place_z")["unit"] == "m"
    report = "\n".join(results.report(without_nan(results.summary)))
    assert "left: angle: 5.7 deg off at the end" in report
    assert "67 % of the ticks" in report


@pytest.mark.parametrize("with_truth", [True, False])
def test_every_quantity_is_drawn(with_truth: bool) -> None:
    results = evaluate_rows(record(with_truth=with_truth), rows, UNITS)
    assert set(results.plots) == {"angle.png", "place.png", "count.png"}
    for draw in results.plots.values():
        assert draw() is not None


def test_of_what_nobody_knows_no_error_is_claimed() -> None:
    results = evaluate_rows(record(with_truth=False), rows, UNITS)
    summary = without_nan(results.summary)
    json.dumps(summary, allow_nan=False)
    angle = summary["modalities"]["left"]["quantities"]["angle"]
    assert angle == {"estimated": 1.0, "unit": "rad"}
    assert "left: angle: no truth is given" in results.report(summary)
    for metric in error_metrics(UNITS):  # No line of dashes stands in a table.
        if metric.name.startswith("angle"):
            with pytest.raises(KeyError):
                metric.value(summary["modalities"]["left"])


def test_where_no_deviation_is_reported_only_errors_are_told() -> None:
    results = evaluate_rows(record(), lambda *_: [scalar("angle", 1.0, true=1.5)], UNITS)
    summary = without_nan(results.summary)
    assert results.report(summary)[0] == "left: angle: -29 deg off at the end, 29 deg RMS"


def test_metrics_of_the_errors_are_read_from_the_summary() -> None:
    summary = evaluate_rows(record(), rows, UNITS).summary
    metrics = {metric.name: metric for metric in error_metrics({"angle": "rad", "place_x": "m"})}
    assert len(metrics) == 6
    left = summary["modalities"]["left"]
    assert_allclose(metrics["angle_final_error"].value(left), 0.1)
    assert metrics["angle_final_error"].unit == "rad"
    assert metrics["angle_inside_two_sigma"].unit == "share"
    assert metrics["place_x_rms_error"].value(left) == 0.0


def test_a_metric_of_a_vector_is_told_to_name_a_component() -> None:
    (left, _, _) = error_metrics({"place": "m"})
    summary = evaluate_rows(record(), rows, UNITS).summary
    told = "its components are place_x, place_y, place_z"
    with pytest.warns(EvaluationWarning, match=told), pytest.raises(KeyError):
        left.value(summary["modalities"]["left"])


def test_an_estimate_that_is_never_a_number_is_no_success() -> None:
    def lost(estimator: str, tick: Tick, station: Tick) -> list[Row]:
        return [scalar("angle", np.nan if estimator == "left" else 1.0)]

    assert evaluate_rows(record(), lost, UNITS).failure == "'angle' of 'left' is never a number"
    assert evaluate_rows(record(), rows, UNITS).failure is None


def test_an_estimate_that_is_lost_on_the_way_is_no_success() -> None:
    first, *later = (tick.time for tick in record().station)

    def lost(estimator: str, tick: Tick, station: Tick) -> list[Row]:
        return [scalar("angle", 1.0 if station.time == first else np.nan, true=1.0, std=1.0)]

    results = evaluate_rows(record(), lost, UNITS)
    assert results.failure == f"'angle' of 'left' is no number from {later[0]:.2f} s on"
    assert "no number in 67 % of the ticks" in results.report(without_nan(results.summary))[0]


@pytest.mark.parametrize(
    ("covariance", "true", "reason"),
    [
        (np.eye(4), np.zeros(2), r"'p' has 2 components and a covariance of shape \(4, 4\)"),
        (np.eye(2), np.zeros(3), r"'p' has 2 components and a truth of shape \(3,\)"),
        (-np.eye(2), np.zeros(2), "'p' has a negative variance: -1"),
    ],
)
def test_a_covariance_that_cannot_be_one_is_refused(
    covariance: np.ndarray, true: np.ndarray, reason: str
) -> None:
    with pytest.raises(ValueError, match=reason):
        vector("p", np.zeros(2), covariance, true)


def test_an_application_may_say_why_its_task_was_not_done() -> None:
    results = evaluate_rows(
        record(), rows, UNITS, failure=lambda record, table: f"{len(table)} rows"
    )
    assert results.failure == f"{len(results.estimates)} rows"


def test_a_quantity_without_a_unit_is_named() -> None:
    with pytest.warns(EvaluationWarning, match="'count' has no unit"):
        evaluate_rows(record(), rows, {"angle": "rad", "place": "m"})


@pytest.mark.parametrize(("size", "names"), [(2, ["x", "y"]), (4, ["0", "1", "2", "3"])])
def test_vectors_of_any_size_have_a_row_for_each_component(size: int, names: list[str]) -> None:
    found = vector("place", np.arange(size), np.eye(size), np.zeros(size))
    assert [row[1] for row in found] == names
