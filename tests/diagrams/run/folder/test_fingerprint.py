"""What decides whether a finished run is still the one that a scenario would give."""

from dataclasses import replace
from pathlib import Path

import grimp
import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.run.folder.fingerprint import PRESENTATION, only_shows, scenario_hash

ROOT = Path(__file__).parents[4]
# Who may use what only shows: it is drawn, listed or measured there, and nothing computed with it.
USERS = {
    "crossmodal.diagrams.crossmodal.application",
    "crossmodal.diagrams.crossmodal.results.results",
    "crossmodal.diagrams.crossmodal.studies.ablation_study",  # Its table.
    "crossmodal.diagrams.crossmodal.training.network_training",  # By which program, on its card.
    "crossmodal.diagrams.evaluation.estimates",
    "crossmodal.diagrams.flap.application",
    "crossmodal.diagrams.flap.results.results",
    "crossmodal.diagrams.joints.mechanics_record",  # The digits of a printed line.
    "crossmodal.diagrams.run.episode",  # How much memory it took.
    "crossmodal.diagrams.run.folder.run_folder",
    "crossmodal.diagrams.stations.truth_paths",  # Names in a message.
}


def test_the_versions_that_ran_a_scenario_do_not_make_it_another() -> None:
    _, scenario = load_scenario("drawer")
    first = scenario_hash(APPLICATION, scenario)
    assert scenario_hash(APPLICATION, replace(scenario, versions={"drake": "1.0"})) == first
    assert scenario_hash(APPLICATION, replace(scenario, seed=1)) != first


@pytest.mark.parametrize("place", PRESENTATION)
def test_what_only_shows_is_there(place: str) -> None:
    assert (ROOT / place).exists()


def test_nothing_that_decides_an_episode_s_numbers_uses_what_only_shows() -> None:
    graph = grimp.build_graph("crossmodal", cache_dir=None)

    def shows(module: str) -> bool:
        path = module.removeprefix("crossmodal.").replace(".", "/")
        return only_shows(path) or only_shows(f"{path}.py")

    used = {
        importer
        for module in graph.modules
        if shows(module)
        for importer in graph.find_modules_that_directly_import(module)
        if not shows(importer)
    }
    assert used == USERS


def test_a_file_is_meant_by_its_path_and_not_by_its_name() -> None:
    assert only_shows("diagrams/drawing/palette.py")
    for place in ("systems/vision/metrics.py", "diagrams/drawings.py", "systems/drawing/a.py"):
        assert not only_shows(place)
