from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from synthetic_episode import synthetic_episode

from diagrams.evaluation import summarise
from diagrams.experiment_table import (
    RESULT_FILES,
    markdown,
    median_p90,
    result_rows,
    table_rows,
    write_results,
)
from diagrams.experiments import (
    EXPERIMENTS,
    find_experiment,
    open_evaluation_folder,
    parse_seeds,
)
from diagrams.network_training import hand_bending_card
from diagrams.run_folder import write_text
from diagrams.scenario import scenario_files
from diagrams.yaml_schema import ScenarioError
from systems.port_values import JointType


def summaries(count: int = 4) -> list[dict[str, Any]]:
    return [summarise(synthetic_episode(seed=seed)) for seed in range(count)]


def broken(seed: int) -> dict[str, Any]:
    return {"scenario": "drawer", "seed": seed, "success": False, "failure": "RuntimeError: no",
            "modalities": {}, "phases": {}}  # fmt: skip


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_has_a_scenario(name: str) -> None:
    assert find_experiment(name).scenario in scenario_files()


@pytest.mark.parametrize(
    ("text", "expected"),
    [("100:103", [100, 101, 102]), ("7", [7]), ("1,4,9", [1, 4, 9]), ("3:5,4,8", [3, 4, 8])],
)
def test_seeds_are_ranges_and_lists(text: str, expected: list[int]) -> None:
    assert parse_seeds(text) == expected


@pytest.mark.parametrize("text", ["", "a", "1:", "5:5", "-3", "1;2"])
def test_other_seeds_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match="--seeds"):
        parse_seeds(text)


def test_medians_count_what_is_missing_as_infinitely_wrong() -> None:
    values = np.array([0.001, -0.002, 0.003, np.nan])
    assert median_p90(values[:3], 1000.0, "mm", 1) == "2.0 (3.0) mm"
    assert median_p90(values, 1000.0, "mm", 1) == "3.0 (none) mm"
    assert median_p90([None, None], 1.0, "s", 1) == "none (none) s"
    assert median_p90([], 1.0, "s", 1) == "-"


def test_rows_hold_every_seed_and_modality_and_the_reasons_of_failures() -> None:
    rows = result_rows([*summaries(2), broken(9)])
    assert len(rows) == 7
    assert set(rows.modality.dropna()) == {"vision", "proprioception", "crossmodal"}
    assert rows[rows.seed == 9].failure.item() == "RuntimeError: no"
    assert np.allclose(rows.configuration_true.dropna(), 0.24)


def test_the_table_counts_broken_episodes_against_every_modality() -> None:
    good, bad = summaries(4), broken(9)
    modalities, table = table_rows([*good, bad])
    rows = {row[0]: row[1:] for row in table}
    assert modalities == ["vision", "proprioception", "crossmodal"]
    assert rows["task done"] == ["4/5"] * 3
    assert rows["joint type right at the end"] == ["4/5"] * 3
    assert all("none" in cell for cell in rows["opening error at the end, median (p90)"])
    assert (
        "none"
        not in dict((r[0], r[3]) for r in table_rows(good)[1])[
            "opening error at the end, median (p90)"
        ]
    )


def test_the_markdown_table_stands_beside_the_paper() -> None:
    references = EXPERIMENTS["drawer-lights-off"].references
    text = markdown("drawer", references, [*summaries(3), broken(3)])
    lines = text.splitlines()
    assert lines[0] == "# drawer: 4 episodes, seeds 0 to 3"
    assert len({line.count("|") for line in lines[2:13]}) == 1
    assert "cross-modal 2 mm (one run)" in text
    assert "66.7 ms budget" in text
    assert "| 3 | RuntimeError: no |" in text


def test_results_are_written_even_if_all_episodes_broke(tmp_path: Path) -> None:
    files = write_results(tmp_path, "drawer", {}, [broken(1)])
    assert [path.name for path in files] == list(RESULT_FILES)
    assert write_results(tmp_path, "drawer", {}, []) == []


def test_a_door_is_reported_in_degrees(tmp_path: Path) -> None:
    doors = [summarise(synthetic_episode(JointType.REVOLUTE, seed=seed)) for seed in range(3)]
    write_results(tmp_path, "door", {}, doors)
    text = (tmp_path / "table.md").read_text()
    assert "axis distance, median (p90)" in text
    assert " deg |" in text
    assert len(pd.read_csv(tmp_path / "results.csv")) == 9
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")


def test_a_folder_of_something_else_is_not_taken_for_an_experiment(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    assert open_evaluation_folder(folder, "drawer") == folder
    assert open_evaluation_folder(folder, "drawer") == folder
    with pytest.raises(ScenarioError, match="holds the experiment 'drawer'"):
        open_evaluation_folder(folder, "door")
    write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match="already holds files"):
        open_evaluation_folder(tmp_path, "drawer")


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
