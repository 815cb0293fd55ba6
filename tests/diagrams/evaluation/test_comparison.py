"""Two folders side by side: figures, what differs in their scenarios, pictures."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from toy_application import TOY, toy_summary

from crossmodal.diagrams.evaluation.comparison import (
    Compared,
    comparison,
    comparison_page,
    figures_table,
    read_compared,
    scenarios_table,
)
from crossmodal.diagrams.evaluation.metric_table import mean_share, value_at
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def find(system: str, source: str) -> Application:
    assert system == "toy"
    return TOY


def write_episode(folder: Path, summary: dict[str, Any], scenario: str = "") -> Path:
    (folder / "figures").mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps(summary))
    text = f"system: toy\nseed: {summary['seed']}\nlens: {{angle: 58.0, tilt: 0.0}}\n{scenario}"
    (folder / "scenario.yaml").write_text(text)
    Image.new("RGB", (4, 3)).save(folder / "figures" / "errors_over_time.png")
    return folder


def read(folder: Path, name: str = "") -> Compared:
    return read_compared(folder, name or folder.name, find)


def rows(compared: list[Compared]) -> dict[tuple[str, str], list[str]]:
    return {(title, of): cells for title, of, *cells in figures_table(compared).rows}


@pytest.fixture
def two_runs(tmp_path: Path) -> list[Compared]:
    before = write_episode(tmp_path / "before", toy_summary(3, left=0.002, right=None))
    after = toy_summary(3, left=-0.0005, right=0.004, score=1) | {"duration": 21.5}
    return [read(before), read(write_episode(tmp_path / "after", after, "lamp: 0.5\n"))]


def test_two_runs_stand_side_by_side_with_their_differences(two_runs: list[Compared]) -> None:
    assert figures_table(two_runs).header == ["", "", "before", "after", "after - before"]
    assert comparison(two_runs).startswith("before: seed 3.\n\nafter: seed 3.\n\n|")
    found = rows(two_runs)
    assert found["error of the distance", "the left eye"] == [
        "2 mm", "0.500 mm", "-1.5 mm, better",
    ]  # fmt: skip
    assert found["error of the distance", "right"] == ["-", "4 mm", "-"]
    assert found["duration", ""] == ["20 s", "21.5 s", "+1.5 s"]
    assert found["scored", ""] == ["yes", "no", "differs, worse"]
    assert found["done", ""] == ["yes", "yes", "same"]
    assert ("peak memory", "") not in found  # It only shows how busy the machine was.
    assert not any("tick" in title for title, _ in found)


def test_a_share_of_one_is_no_truth(tmp_path: Path, two_runs: list[Compared]) -> None:
    whole = toy_summary(3, left=None, right=None) | {"duration": 1.0}
    two_runs[0] = read(write_episode(tmp_path / "whole", whole))
    assert rows(two_runs)["duration", ""] == ["1 s", "21.5 s", "+20 s"]


def test_what_differs_in_the_last_bits_is_the_same(two_runs: list[Compared]) -> None:
    figures = two_runs[1].figures
    figures.loc[figures["metric"] == "distance_error", "value"] = 0.002 + 1e-12
    assert rows(two_runs)["error of the distance", "the left eye"][-1] == "same"


def test_each_figure_has_its_own_unit_and_none_is_taken_from_one_of_another(
    two_runs: list[Compared],
) -> None:
    figures = two_runs[1].figures
    figures.loc[figures["metric"] == "distance_error", "unit"] = "rad"
    assert rows(two_runs)["error of the distance", "the left eye"] == ["2 mm", "0.0286 deg", "-"]


def test_rows_after_the_eighth_and_keys_that_only_one_has_are_for_who_asks(
    two_runs: list[Compared],
) -> None:
    two_runs[0].document |= {f"key{number}": number for number in range(9)}
    for one, duration in zip(two_runs, (20.0, 30.0), strict=True):
        one.document["duration"] = duration
    assert scenarios_table(two_runs).rows[0] == ["duration [s]", "20.0", "30.0"]
    assert "more rows: 3, see --all" in comparison(two_runs)
    assert "--all" not in comparison(two_runs, most=None)
    assert "<summary>more rows (3)</summary>" in comparison_page(two_runs, "")


def test_only_the_keys_that_differ_are_shown_with_their_values(two_runs: list[Compared]) -> None:
    assert scenarios_table(two_runs).rows == [["lamp", "-", "0.5"]]
    two_runs[1].document["lens.angle"] = 60.0
    assert ["lens.angle", "58.0", "60.0"] in scenarios_table(two_runs).rows
    assert "Their scenarios say the same." in comparison(two_runs[:1] * 2)


@pytest.fixture
def evaluations(tmp_path: Path) -> list[Compared]:
    for name, worse in (("first", 1.0), ("second", 3.0)):
        for seed in range(1, 4):
            error = None if worse * seed == 9.0 else 0.001 * worse * seed
            score = 5 if worse * seed < 5.0 else 1
            summary = toy_summary(seed, left=error, right=None, score=score)
            write_episode(tmp_path / name / f"seed-{seed:04d}", summary)
        Image.new("RGB", (4, 3)).save(tmp_path / name / "errors_at_end.png")
    return [read(tmp_path / "first"), read(tmp_path / "second")]


def test_evaluations_are_compared_by_medians_and_counts(evaluations: list[Compared]) -> None:
    assert evaluations[0].heading == "first: 3 episodes, seeds 1 to 3"
    found = rows(evaluations)
    assert found["error of the distance", "the left eye"] == [
        "2.0 (1.0 to 3.0) mm", "6 (3 to none) mm", "+4 mm, worse",
    ]  # fmt: skip
    assert found["scored", ""] == ["3/3", "1/3", "-67 %, worse"]
    assert scenarios_table(evaluations).rows == []


def test_shares_are_compared_by_their_means_as_the_evaluations_table_has_them(
    tmp_path: Path,
) -> None:
    inside = Metric(
        name="inside",
        value=value_at("inside"),
        unit="share",
        by_estimator=False,
        title="inside",
        cell=mean_share,
    )
    application = replace(TOY, metrics=[*TOY.metrics, inside])
    compared = []
    for name, shares in (("first", (0.0, 0.9, 0.9)), ("second", (0.3, 0.3, 0.9))):
        for seed, share in enumerate(shares, start=1):
            summary = toy_summary(seed, left=0.001, right=None) | {"inside": share}
            write_episode(tmp_path / name / f"seed-{seed:04d}", summary)
        compared.append(read_compared(tmp_path / name, name, lambda *_: application))
    assert rows(compared)["inside", ""][:3] == ["60 %", "50 %", "-10 %"]


def test_the_page_has_each_picture_of_all_of_them_side_by_side(
    evaluations: list[Compared], two_runs: list[Compared]
) -> None:
    text = comparison_page(two_runs, "made so")
    assert text.count('src="data:image/png') == 2
    assert text.index("<img") < text.index("<table")
    assert 'class="good">-1.5 mm, better</td>' in text
    assert "errors over time" in text
    assert "<td>+1.5 s</td>" in text
    mixed = comparison_page([evaluations[0], two_runs[0]], "")
    assert mixed.count("<h2") == 1


def test_no_link_is_followed_out_of_a_run(tmp_path: Path) -> None:
    folder = write_episode(tmp_path / "run", toy_summary(3, left=0.002, right=None))
    (tmp_path / "mine.png").write_text("a secret")
    (folder / "figures" / "mine.png").symlink_to(tmp_path / "mine.png")
    (folder / "figures" / "same.png").symlink_to(folder / "figures" / "errors_over_time.png")
    assert sorted(read(folder).pictures) == ["errors over time", "same"]
    (folder / "scenario.yaml").rename(tmp_path / "mine.yaml")
    (folder / "scenario.yaml").symlink_to(tmp_path / "mine.yaml")
    with pytest.raises(ScenarioError, match="is a link out of"):
        read(folder)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("{", "summary.json: is no summary"), ("[]", "is no summary"), ('{"a": 1}', "is no summary")],
)
def test_a_damaged_summary_is_named(tmp_path: Path, text: str, expected: str) -> None:
    folder = write_episode(tmp_path / "run", toy_summary(3, left=0.1, right=0.1))
    (folder / "summary.json").write_text(text)
    with pytest.raises(ScenarioError, match=expected):
        read(folder)
    with pytest.raises(ScenarioError, match="neither a summary"):
        read(tmp_path)


def test_what_an_application_does_not_write_is_not_compared(tmp_path: Path) -> None:
    wrong = toy_summary(3, left=0.1, right=0.1) | {"score": "many"}
    folder = write_episode(tmp_path / "run", wrong)
    with pytest.raises(ScenarioError, match="is no summary of a run of 'toy'"):
        read(folder)
