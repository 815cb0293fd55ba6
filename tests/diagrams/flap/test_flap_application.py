"""The flap application as a whole: its wires, and what a short episode leaves behind."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from truth_paths import truth_paths, truth_references

from crossmodal.diagrams.applications import applications, load_scenario, scenarios_of
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.flap.application import APPLICATION
from crossmodal.diagrams.flap.episode_parts import PERCEIVED
from crossmodal.diagrams.flap.estimator_names import ESTIMATORS
from crossmodal.diagrams.flap.experiments import EXPERIMENTS
from crossmodal.diagrams.flap.meshcat_view import MeshcatView
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import replay

FELT = {"contact_position", "contact_force", "pad_out_of_flap"}
ESTIMATES = {"axis", "theta", "L1", "L2", "flap_seen", "stream_age", "stream_fault", *FELT}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flap")


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("flap", ["duration=0.5", "seed=2"])[1]


@pytest.fixture(scope="module")
def episode(scenario, folder: Path) -> Episode:
    return Episode(APPLICATION, scenario, sensors_file=folder / "sensors.mcap")


@pytest.fixture(scope="module")
def record(episode: Episode) -> EpisodeRecord:
    return episode.Run()


def test_it_is_one_of_the_applications():
    assert applications()["flap"] is APPLICATION
    assert {e.scenario for e in EXPERIMENTS.values()} <= set(scenarios_of(APPLICATION))


def test_nothing_true_reaches_what_the_robot_runs(episode: Episode) -> None:
    assert truth_paths(episode.diagram) == []
    assert truth_references(episode.diagram) == []


def test_the_first_estimator_is_what_the_fingertip_rolls_by(episode: Episode, scenario) -> None:
    acting = episode.estimators[scenario.acting_estimator]
    station = episode.station.diagram
    told = {
        target[1]
        for target, source in episode.diagram.connection_map().items()
        if source[0] is acting and target[0] is station
    }
    assert told == {station.GetInputPort(port).get_index() for port in PERCEIVED}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_each_estimator_is_a_diagram_that_needs_only_what_the_station_measures(
    name: str, episode: Episode, scenario
) -> None:
    estimator = episode.estimators[name]
    station = episode.station.diagram
    for index in range(estimator.num_input_ports()):
        port = estimator.get_input_port(index).get_name()
        assert station.HasOutputPort(port)
        assert not port.startswith("cheat_")


def test_a_short_episode_is_no_success_and_says_why(record: EpisodeRecord) -> None:
    results = APPLICATION.evaluate(record)
    assert results.success is False
    assert "never began to turn" in str(results.failure)
    assert set(results.summary["modalities"]) == set(ESTIMATORS)
    assert set(results.estimates["quantity"].unique()) <= ESTIMATES
    assert results.report(results.summary)


def test_its_folder_can_be_written_and_replayed(
    record: EpisodeRecord, scenario, folder: Path
) -> None:
    files = write_run(folder, APPLICATION, record, APPLICATION.evaluate(record))
    assert {"summary.json", "angle.png", "tool.png", "frames.png"} <= {file.name for file in files}
    again = replay(APPLICATION, folder, scenario)
    for name in ESTIMATORS:
        for old, new in zip(
            record.estimators[name].ticks, again.estimators[name].ticks, strict=False
        ):
            np.testing.assert_allclose(
                new.values["fingertip_contact_latest"].X_WS,
                old.values["fingertip_contact_latest"].X_WS,
                atol=1e-9,
            )


def test_the_estimators_can_be_wired_apart_from_the_station(scenario) -> None:
    calibration = APPLICATION.make_calibration(scenario)
    builder = DiagramBuilder()
    for name, estimator in APPLICATION.make_estimators(scenario, calibration).items():
        builder.AddNamedSystem(name, estimator)
    assert len(builder.GetSystems()) == len(ESTIMATORS)


def test_the_view_has_as_many_taxels_as_the_fingertip() -> None:
    taxels = "[[0.003, 0.0035], [-0.003, 0.0035], [0.003, -0.0035], [-0.003, -0.0035]]"
    _, few = load_scenario("flap", [f"finger.taxels={taxels}"])
    line = np.zeros(3), np.ones(3)
    view = MeshcatView(start_meshcat("localhost"), [], few.finger.layout(), line)
    assert view.GetInputPort("taxel_measured").size() == 4
