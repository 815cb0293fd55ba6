"""Ablations name what exists; a finished one is read, not simulated again."""

import json
from pathlib import Path

import pytest
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.estimators import CROSSMODAL_CONNECTIONS
from crossmodal.diagrams.crossmodal.studies import ablation_study
from crossmodal.diagrams.crossmodal.studies.ablation_study import run_ablation, table
from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS, Ablation, find_ablation
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def joint(error: float | None, estimated: str = "prismatic") -> dict:
    return {
        "type_true": "prismatic",
        "type_estimated": estimated,
        "configuration_error": error,
        "axis_angle_error": 0.01,
    }


@pytest.mark.parametrize("name", ABLATIONS)
def test_every_ablation_cuts_a_wire_that_exists(name: str) -> None:
    assert ABLATIONS[name].connection in CROSSMODAL_CONNECTIONS


def test_an_unknown_ablation_lists_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match=r"unknown ablation 'nose'.*seen-reference"):
        find_ablation("nose")


def test_the_table_says_medians_and_what_was_lost() -> None:
    rows = [
        {"whole": joint(-1e-3), "cut": joint(5e-3)},
        {"whole": joint(3e-3), "cut": joint(None, "revolute")},
        {"whole": joint(2e-3), "cut": joint(7e-3)},
    ]
    whole, cut = table({"body-in-the-hand": rows}).splitlines()[2:]
    assert "| whole | 3/3 | 2 (3) mm |" in whole
    assert "| cut | 2/3 | 6 (7) mm, none in 1 |" in cut


def test_a_finished_ablation_is_not_simulated_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ablation = Ablation(flow="", scenario="drawer", connection="joints_to_vision")
    application, scenario = load_scenario("drawer", ["seed=4", "modalities=[crossmodal]"])
    wirings = {"whole": joint(1e-3), "cut": joint(2e-3)}
    known = fingerprint(application, scenario) | {"connection": ablation.connection}
    known["wirings"] = wirings
    (tmp_path / "ablation.json").write_text(json.dumps(known))

    def simulate(*_: object, **__: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(ablation_study, "run_episode", simulate)
    assert run_ablation(APPLICATION, ablation, 4, tmp_path) == wirings
    with pytest.raises(AssertionError, match="simulated"):
        run_ablation(APPLICATION, ablation, 5, tmp_path)


def test_an_interrupted_ablation_is_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulate(*_: object, sensors_file: Path) -> EpisodeRecord:
        sensors_file.touch()
        record = synthetic_episode(seed=4)
        record.interrupted = True
        return record

    monkeypatch.setattr(ablation_study, "run_episode", simulate)
    with pytest.raises(KeyboardInterrupt):
        run_ablation(APPLICATION, ABLATIONS["body-in-the-hand"], 4, tmp_path)
    assert not any(tmp_path.iterdir())
