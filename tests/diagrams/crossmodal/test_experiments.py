import pytest

from diagrams.crossmodal.scenario import scenario_files
from diagrams.crossmodal.studies.experiments import EXPERIMENTS, find_experiments, parse_seeds
from diagrams.crossmodal.training.network_training import hand_bending_card
from diagrams.evaluation.metric_table import ROW_TITLES
from diagrams.run.yaml_schema import ScenarioError


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_reference_names_a_row_of_the_table(name: str) -> None:
    assert set(EXPERIMENTS[name].references) <= set(ROW_TITLES)


def test_all_names_every_experiment_whose_scenario_there_is() -> None:
    found = find_experiments("all")
    assert "drawer" in found
    assert {one.scenario for one in found.values()} <= set(scenario_files())


def test_an_unknown_experiment_lists_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match=r"did you mean 'drawer'.*box-lid.*tripod"):
        find_experiments("drawr")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("100:103", [100, 101, 102]),
        ("2", [100, 101]),
        ("7:8", [7]),
        ("1,4,9", [1, 4, 9]),
        ("3:5,4,8", [3, 4, 8]),
    ],
)
def test_seeds_are_counts_ranges_and_lists(text: str, expected: list[int]) -> None:
    assert parse_seeds(text) == expected


@pytest.mark.parametrize("text", ["", "0", "a", "1:", "5:5", "-3", "1;2", "1,,2"])
def test_other_seeds_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match="--seeds"):
        parse_seeds(text)


def test_a_card_sets_unseen_errors_beside_those_of_no_bending() -> None:
    error = {"rotation_rms_deg": 1.234, "translation_rms_mm": 2.5}
    facts = {"data": "15 interactions", "split": "pairs", "metric": "rms", "command": "train",
             "hidden": [10, 10, 10], "unseen": error, "no_bending": error, "seen": error,
             "unseen_within_2_sigma": 0.934}  # fmt: skip
    topologies = [{"hidden": (10, 10), "score": 0.25, **error}]
    card = hand_bending_card(facts, topologies)
    assert "| unseen interactions | 1.23 | 2.50 |" in card
    assert "| the same, if there were no bending | 1.23 | 2.50 |" in card
    assert "translation rms [mm]" in card
    assert "93 %" in card
    assert "| 10-10 | 0.25 | 1.23 | 2.50 |" in card
