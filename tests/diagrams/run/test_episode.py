"""A short episode, whole: the hand holds the handle by contact and pulls; its numbers repeat."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pandas.testing import assert_frame_equal
from pydrake.geometry import Box

from crossmodal.diagrams.applications import RecordedRun, load_recorded, load_scenario, read_run
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, joint_episode
from crossmodal.diagrams.run.build import build_station, building
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def test_what_is_of_a_recording_is_not_simulated() -> None:
    application, scenario = load_scenario("drawer", ["replay=kitchen.bag --robot wam"])
    with pytest.raises(ScenarioError, match=r"repeat it by `crossmodal replay kitchen.bag --rob"):
        run_episode(application, scenario)


@pytest.fixture(scope="module")
def run(recorded_run: Path) -> RecordedRun:
    return read_run(recorded_run)


@pytest.fixture(scope="module")
def episode(recorded_run: Path) -> JointEpisode:
    """Its truth and what the robot did, beside what is quickly perceived."""
    application, scenario = load_recorded(recorded_run, ["modalities=[proprioception]"])
    return joint_episode(replay(application, recorded_run, scenario))


def test_the_drawer_is_pulled_open_by_contact_alone(
    run: RecordedRun, episode: JointEpisode
) -> None:
    assert run.summary["failure"] is None
    assert 0.05 < episode.truth.opening()[-1] < 0.08


def test_the_object_rests_until_the_hand_closes(episode: JointEpisode) -> None:
    before = episode.truth.times < 2.0
    assert_allclose(episode.truth.configuration[before], 0.0, atol=1e-4)


def test_what_the_robot_says_that_it_does_ends_the_episode(
    run: RecordedRun, episode: JointEpisode
) -> None:
    events = episode.record.events
    assert [event.name for event in events] == ["closing", "exploring", "stopped"]
    assert_allclose(run.summary["duration"], events[-1].time + 1.0, atol=1e-6)
    assert events[0].time < episode.truth.grasp_time <= events[1].time + 1e-6


def test_cross_modal_perception_finds_the_slide(run: RecordedRun) -> None:
    joint = run.summary["modalities"]["crossmodal"]["joints"][0]
    assert joint["type_estimated"] == "prismatic"
    assert abs(joint["configuration_error"]) < 0.001
    assert joint["axis_angle_error"] < np.deg2rad(3.0)


def test_every_estimator_ticks_at_the_networks_rate(run: RecordedRun) -> None:
    estimates = run.estimates
    assert set(estimates.modality.unique()) == set(run.scenario.modalities)
    for _, of_modality in estimates.groupby("modality", observed=True):
        times = of_modality[of_modality.quantity == "stream_age"].time.unique()
        assert_allclose(np.diff(times), 1 / 15, atol=1e-9)
        assert len(times) == round(run.summary["duration"] * 15)


def test_the_same_seed_gives_the_same_numbers(run: RecordedRun) -> None:
    # The hand closes from 3 s on, and pulls from 4.5 s on.
    again = run_episode(*load_scenario(str(run.folder / SCENARIO_FILE), ["duration=5"]))
    columns = ["time", "modality", "quantity", "component", "estimate", "std"]
    second = APPLICATION.evaluate(again).estimates[columns].reset_index(drop=True)
    first = run.estimates[run.estimates.time <= second.time.max()][columns]
    assert_frame_equal(
        first.reset_index(drop=True),
        second,
        check_exact=True,
        check_categorical=False,
        check_dtype=False,
    )
    assert len(second) > 2000


@pytest.mark.parametrize("assignment", ["plant.contact_approximation=foo", "plant.scene=table.sdf"])
def test_what_drake_refuses_is_a_fault_of_the_scenario(assignment: str) -> None:
    with pytest.raises(ScenarioError, match=r"^drawer: "):
        build_station(*load_scenario("drawer", [assignment]))


def test_a_demand_of_drakes_that_fails_is_one_line() -> None:
    words = r"mine: test_episode\.py:\d+: Failure at .* in Box\(\): condition"
    with pytest.raises(ScenarioError, match=words), building("mine"):
        Box(0.0, 1.0, 1.0)
    with pytest.raises(SystemExit), building("mine"):
        raise SystemExit(3)
