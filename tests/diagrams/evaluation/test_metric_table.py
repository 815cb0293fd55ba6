import math
from typing import Any

import numpy as np
import pytest
from toy_application import TOY, toy_summary

from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.metric_table import (
    COLUMNS,
    count,
    count_of_known,
    experiment_tables,
    failures_table,
    markdown,
    mean_and_deviation,
    mean_share,
    median_and_range,
    overall_table,
    quantile,
    seed_ranges,
    tidy_metrics,
)
from crossmodal.diagrams.run.experiment import Experiment, Reference

NAN = float("nan")
EXPERIMENT = Experiment(
    scenario="door",
    description="",
    references={
        "configuration_error": Reference(paper="5 deg", goal="2 deg"),
        "exploration_error": Reference(paper="1.3 deg"),
    },
)


def summary(seed: int, error: float | None, *, kind: str = "revolute") -> dict[str, Any]:
    """An episode whose vision sees no joint and whose cross-modal network errs by `error`."""

    def modality(type_estimated: str | None, error: float | None) -> dict[str, Any]:
        joint = {
            "type_true": kind,
            "type_estimated": type_estimated,
            "type_settled_at": error,
            "configuration_true": 1.0,
            "configuration_error": error,
            "configuration_error_last_seen": error,
            "axis_angle_error": error,
            "axis_distance_error": error,
            "consistency": {"configuration": error and 0.9, "axis": error and 0.8},
            "configuration_error_at_turn": error,
            "configuration_rms_moving": error,
            "axis_angle_error_at_turn": error,
            "configuration_inside_two_sigma": error and True,
            "axis_inside_two_sigma": error and False,
        }
        return {"joints": [joint], "tick": {"median": 0.02, "p95": 0.03}}

    return {
        "scenario": "door",
        "seed": seed,
        "success": True,
        "failure": None,
        "duration": 20.0,
        "wall_time": 10.0,
        "real_time_factor": 2.0,
        "peak_memory": 1e9,
        "modalities": {
            "vision": modality(None, None),
            "crossmodal": modality(kind if error is not None else "rigid", error),
        },
        "phases": {"exploration": {"target": 1.0, "reached": 1.01, "error": 0.01}},
    }


def broken(seed: int) -> dict[str, Any]:
    return {
        "scenario": "door",
        "seed": seed,
        "success": False,
        "failure": "RuntimeError: no | way",
        "modalities": {},
        "phases": {},
    }


def cells(summaries: list[dict[str, Any]]) -> dict[str, list[str]]:
    tables = experiment_tables(
        APPLICATION, EXPERIMENT, tidy_metrics(APPLICATION, "door", summaries)
    )
    return {row[0]: row[1:] for table in tables for row in table.rows}


def test_the_tidy_table_has_one_row_per_episode_modality_and_figure() -> None:
    figures = tidy_metrics(APPLICATION, "door", [summary(3, 0.1), broken(4)])
    assert tuple(figures.columns) == COLUMNS
    assert not figures.duplicated(["experiment", "seed", "modality", "metric"]).any()
    error = figures[(figures.modality == "crossmodal") & (figures.metric == "configuration_error")]
    assert (error.value.item(), error.unit.item()) == (0.1, "rad")
    assert len(figures[figures.modality == "vision"]) == len(
        figures[figures.modality == "crossmodal"]
    )
    last = figures[figures.seed == 4]
    assert last[["metric", "value", "reason"]].values.tolist() == [
        ["success", 0.0, "RuntimeError: no | way"]
    ]


def test_quantiles_are_linear_and_what_is_missing_is_infinitely_large() -> None:
    values = [0.4, -0.1, 0.2, 0.3, 0.5]
    for share in (0.05, 0.37, 0.5, 0.95):
        np.testing.assert_allclose(quantile(values, share), np.quantile(np.abs(values), share))
    assert quantile([0.1, 0.2, NAN], 0.5) == 0.2
    assert quantile([0.1, NAN], 0.5) == np.inf
    assert quantile([NAN, NAN], 0.25) == np.inf


def test_cells_are_written_in_units_for_people() -> None:
    assert median_and_range([0.001, -0.002, 0.003], "m") == "2.0 (1.0 to 3.0) mm"
    assert median_and_range([0.001, 0.002, NAN], "m") == "2.0 (1.0 to none) mm"
    assert median_and_range([np.pi / 180], "rad") == "1 deg"
    assert mean_and_deviation([0.01, -0.03], "m") == "20 ± 14 mm"
    assert mean_and_deviation([0.01, NAN], "m") == "10 mm (1 without)"
    assert mean_and_deviation([NAN], "m") == "-"
    assert count([1.0, 0.0, NAN]) == "1/3"
    assert mean_share([0.5, 1.0, NAN]) == "75 %"


def test_an_episode_that_broke_off_counts_against_every_modality() -> None:
    degree = np.pi / 180
    rows = cells([summary(0, degree), summary(1, 3 * degree), summary(2, 5 * degree), broken(3)])
    assert rows["done"] == ["3/4", ""]
    assert rows["exploration error"] == ["0.57 ± 0.00 deg (1 without)", "1.3 deg"]
    assert rows["joint type right at the end"][:2] == ["0/4", "3/4"]
    assert rows["configuration error at the end"] == [
        "none",
        "4 (1 to none) deg",
        "5 deg",
        "2 deg",
    ]
    assert rows["axis' NEES inside 95 % bounds"][:2] == ["-", "80 %"]
    assert rows["tick"][1] == "20 (20 to 20) ms"
    assert "exploitation error" not in rows


def test_a_joint_of_the_wrong_type_is_found_but_not_right() -> None:
    wrong = summary(0, 0.1)
    wrong["modalities"]["crossmodal"]["joints"][0]["type_estimated"] = "prismatic"
    rows = cells([wrong])
    assert rows["joint found"][:2] == ["0/1", "1/1"]
    assert rows["joint type right at the end"][:2] == ["0/1", "0/1"]


def test_only_revolute_joints_have_a_distance_of_the_axis() -> None:
    assert "axis distance error" in cells([summary(0, 0.1)])
    rows = cells([summary(0, 0.1, kind="prismatic")])
    assert "axis distance error" not in rows
    assert rows["configuration error at the end"][1] == "100 mm"


def test_the_markdown_holds_tables_reasons_and_origin() -> None:
    figures = tidy_metrics(APPLICATION, "door", [summary(0, 0.1), broken(1), summary(2, 0.1)])
    text = markdown(APPLICATION, "door", EXPERIMENT, figures, "made so")
    assert text.startswith("# door: 3 episodes, seeds 0 to 2\n\nmade so\n")
    assert "| 1 | RuntimeError: no \\| way |" in text
    assert "Real-time factor: median 2.00, least 2.00." in text
    for block in text.split("\n\n"):
        counts = {line.replace("\\|", "").count("|") for line in block.splitlines()}
        assert len(counts) == 1 or not block.startswith("|")


def test_there_is_a_table_even_if_all_episodes_broke() -> None:
    figures = tidy_metrics(APPLICATION, "door", [broken(1)])
    assert [table.rows for table in experiment_tables(APPLICATION, EXPERIMENT, figures)] == [
        [["done", "0/1"]]
    ]
    assert failures_table(figures).rows == [["1", "RuntimeError: no | way"]]


def test_the_overall_table_adds_up_the_experiments() -> None:
    doors = tidy_metrics(APPLICATION, "door", [summary(0, 0.1), broken(1)])
    drawers = tidy_metrics(APPLICATION, "drawer", [summary(0, 0.001, kind="prismatic")])
    table = overall_table(
        APPLICATION,
        {
            "glass-door": doors,
            "drawer": drawers,
            "box-lid": tidy_metrics(APPLICATION, "box-lid", [broken(7)]),
        },
    )
    rows = {row[0]: dict(zip(table.header[1:], row[1:], strict=True)) for row in table.rows}
    assert rows["glass-door"]["done"] == "1/2"
    assert rows["all"]["done"] == "2/4"
    assert rows["all"]["type right, cross-modal"] == "2/4"
    assert rows["glass-door"]["exploration error"] == "0.57 deg (1 without)"
    assert rows["drawer"]["exploration error"] == "-"
    assert rows["drawer"]["error at the end, cross-modal"] == "1 mm"
    assert rows["box-lid"]["type right, cross-modal"] == "0/1"
    assert rows["glass-door"]["paper"] == "1.3 ± 0.73 deg / 0.6 ± 0.5 deg"
    assert rows["drawer"]["goal"] == "-"


def test_what_is_not_known_is_not_counted_as_not_done() -> None:
    unknown = summary(2, 0.1) | {"success": None}
    doors = [summary(0, 0.1), unknown, broken(1)]
    for asked, done, right in (
        (3, "1/2 (1 without)", "2/3"),
        (4, "1/2 (1 without)", "2/3"),
    ):
        table = overall_table(
            APPLICATION,
            {"glass-door": tidy_metrics(APPLICATION, "glass-door", doors)},
            {"glass-door": range(asked)},
        )
        row = dict(zip(table.header[1:], table.rows[-1][1:], strict=True))
        assert (row["done"], row["type right, cross-modal"]) == (done, right)


@pytest.mark.parametrize(
    ("seeds", "text"), [([1, 2, 3], "1 to 3"), ([1, 2], "1, 2"), ([1, 3, 4], "1, 3, 4")]
)
def test_seeds_in_a_row_are_written_as_a_range(seeds: list[int], text: str) -> None:
    assert seed_ranges(seeds) == text


def toy_cells(name: str, summaries: list[dict[str, Any]]) -> dict[str, list[str]]:
    figures = tidy_metrics(TOY, name, summaries)
    tables = experiment_tables(TOY, TOY.experiments[name], figures)
    return {row[0]: row[1:] for table in tables for row in table.rows}


def test_an_application_of_two_metrics_has_its_own_tables() -> None:
    summaries = [toy_summary(0, 0.001, 0.004), toy_summary(1, 0.003, None, score=2), broken(2)]
    figures = tidy_metrics(TOY, "near", summaries)
    known = figures[figures.metric == "distance_error"]
    assert sorted(known.value.dropna()) == [0.001, 0.003, 0.004]
    assert set(known.unit) == {"m"}
    first, second = experiment_tables(TOY, TOY.experiments["near"], figures)
    assert first.header == ["", "all episodes", "goal"]
    assert second.header == ["", "the left eye", "right", "paper", "goal"]
    rows = toy_cells("near", summaries)
    assert rows["scored"] == ["1/3", "all"]
    assert rows["error of the distance"] == [
        "3 (1 to none) mm", "none (4 to none) mm", "3 mm", "1 mm"
    ]  # fmt: skip
    assert rows["done"][0] == "2/3"
    assert rows["tick"][0] == "20 (20 to 20) ms"


def test_paper_and_goal_have_columns_where_the_experiment_names_any_for_the_figures() -> None:
    figures = tidy_metrics(TOY, "far", [toy_summary(0, 0.001, 0.004)])
    for table in experiment_tables(TOY, Experiment(scenario="far", description=""), figures):
        assert not {"paper", "goal"} & set(table.header)
    goal = {"distance_error": Reference(goal="1 mm")}
    named = Experiment(scenario="far", description="", references=goal)
    first, second = experiment_tables(TOY, named, figures)
    assert first.header == ["", "all episodes"]  # The goal is none of these figures'.
    assert second.header == ["", "the left eye", "right", "goal"]


def test_a_metric_that_means_nothing_in_an_experiment_has_no_row() -> None:
    assert "scored" not in toy_cells("far", [toy_summary(0, 0.001, 0.004)])
    table = overall_table(
        TOY,
        {name: tidy_metrics(TOY, name, [toy_summary(0, 0.001, 0.004)]) for name in ("near", "far")},
    )
    rows = {row[0]: dict(zip(table.header[1:], row[1:], strict=True)) for row in table.rows}
    assert rows["near"] == {
        "done": "1/1", "left": "1 mm", "scored": "1/1", "paper": "3 mm",
        "goal": "1 mm",
    }  # fmt: skip
    assert rows["far"]["scored"] == "-"
    assert rows["all"]["done"] == "2/2"


def test_a_metric_that_an_episode_does_not_have_is_left_out() -> None:
    without = toy_summary(0, 0.001, 0.004)
    del without["modalities"]["right"]["distance_error"]
    rows = toy_cells("near", [without])
    assert rows["error of the distance"][:2] == ["1 mm", "-"]


def test_a_metric_in_a_unit_of_its_own_is_written_in_it() -> None:
    assert median_and_range([2.0], "px") == "2 px"
    assert mean_and_deviation([1.0, 3.0], "kg") == "2 ± 1 kg"


def test_velocities_are_written_in_millimetres_and_degrees() -> None:
    assert median_and_range([0.002], "m/s") == "2 mm/s"
    assert median_and_range([math.pi / 180.0], "rad/s") == "1 deg/s"


def test_notes_of_the_experiment_and_what_counts_as_done_stand_below_the_tables() -> None:
    figures = tidy_metrics(TOY, "near", [toy_summary(0, 0.001, 0.004)])
    text = markdown(TOY, "near", TOY.experiments["near"], figures, "made so", "Done: seen.")
    assert "- Done: seen.\n- It is near." in text


def test_of_what_has_a_value_is_counted_apart_from_what_has_none() -> None:
    assert count_of_known([1.0, 0.0, NAN]) == "1/2 (1 without)"
    assert count_of_known([1.0]) == "1/1"
    assert count_of_known([NAN]) == "-"


def test_there_are_as_many_digits_as_the_episodes_carry() -> None:
    assert median_and_range([0.00216, 0.00237, 0.00319], "m") == "2.4 (2.2 to 3.2) mm"
    assert median_and_range([0.00004, 0.0001, 0.00506], "m") == "0.1 (0.0 to 5.1) mm"
    many = np.linspace(0.001, 0.002, 10_001)
    assert median_and_range(many, "m") == "1.50 (1.05 to 1.95) mm"
    assert mean_and_deviation([0.010, 0.013, 0.0111], "m") == "11 ± 2 mm"


def test_the_share_of_few_episodes_is_not_written_in_percent() -> None:
    assert count_of_known([1.0] * 19 + [0.0], with_share=True) == "19/20 (95 %)"
    assert count_of_known([1.0, 0.0], with_share=True) == "1/2"
