"""A short episode, whole: the hand holds the handle by contact and pulls; its numbers repeat."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pandas.testing import assert_frame_equal
from pydrake.geometry import Box

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.joints.joint_metrics import (
    JointEpisode,
    configuration_since_grasp,
    joint_episode,
    opening_at,
)
from crossmodal.diagrams.run.episode import build_station, building, run_episode
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import JointType


def short_episode(*overrides: str) -> JointEpisode:
    application, scenario = load_scenario(
        "drawer", ["seed=7", "control.sequence.travel=0.06", "task.opening=0.04", *overrides]
    )
    return joint_episode(run_episode(application, scenario))


def test_what_is_of_a_recording_is_not_simulated() -> None:
    application, scenario = load_scenario("drawer", ["replay=kitchen.bag --robot wam"])
    with pytest.raises(ScenarioError, match=r"repeat it by `crossmodal replay kitchen.bag --rob"):
        run_episode(application, scenario)


@pytest.fixture(scope="module")
def episode() -> JointEpisode:
    return short_episode()


def test_the_drawer_is_pulled_open_by_contact_alone(episode: JointEpisode) -> None:
    assert APPLICATION.evaluate(episode.record).failure is None
    assert 0.05 < episode.truth.opening()[-1] < 0.08


def test_the_object_rests_until_the_hand_closes(episode: JointEpisode) -> None:
    before = episode.truth.times < 2.0
    assert_allclose(episode.truth.configuration[before], 0.0, atol=1e-4)


def test_what_the_robot_says_that_it_does_ends_the_episode(episode: JointEpisode) -> None:
    events = episode.record.events
    assert [event.name for event in events] == ["closing", "exploring", "stopped"]
    assert_allclose(episode.record.duration, events[-1].time + 1.0, atol=1e-6)
    assert events[0].time < episode.truth.grasp_time <= events[1].time + 1e-6


def test_cross_modal_perception_finds_the_slide(episode: JointEpisode) -> None:
    last = episode.record.estimators["crossmodal"].ticks[-1]
    joint = next(
        joint
        for joint in last.values["joints_latest"].joints
        if joint.parent_id == 0 and joint.child_id == 1
    )
    assert joint.type == JointType.PRISMATIC
    truth = episode.truth
    opening = float(opening_at(np.array([last.time]), truth)[0])
    assert abs(configuration_since_grasp(joint, truth, last.time) - opening) < 0.001
    assert abs(joint.model.axis_P @ truth.axis_W) > np.cos(np.deg2rad(3.0))


def test_every_estimator_ticks_at_the_networks_rate(episode: JointEpisode) -> None:
    assert list(episode.record.estimators) == episode.record.scenario.modalities
    for record in episode.record.estimators.values():
        times = np.array([tick.time for tick in record.ticks])
        assert_allclose(np.diff(times), 1 / 15, atol=1e-9)
        assert len(record.tick_times) >= len(times) - 1


def test_the_same_seed_gives_the_same_numbers(episode: JointEpisode) -> None:
    again = short_episode("duration=5")  # The hand closes from 3 s on, and pulls from 4.5 s on.
    columns = ["time", "modality", "quantity", "component", "estimate", "std"]
    first, second = (APPLICATION.evaluate(e.record).estimates for e in (episode, again))
    second = second[columns].reset_index(drop=True)
    first = first[first.time <= second.time.max()][columns].reset_index(drop=True)
    assert_frame_equal(first, second, check_exact=True, check_categorical=False)
    assert len(first) > 2000


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
