"""How long the hand held the handle, and who noticed when it did not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RollPitchYaw
from synthetic_episode import GRASP_TIME, empty_episode, synthetic_episode

from crossmodal.diagrams.crossmodal.results.grasp_episode import (
    GRASP_QUANTITIES,
    bar_shift,
    grasp_episode,
    grasp_lines,
    last_since,
    summarise_grasp,
)
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.crossmodal.task import GRASP_LOST
from crossmodal.diagrams.run.record import EpisodeRecord, Event
from crossmodal.systems.port_values import GraspType
from crossmodal.systems.proprioception.grasp_model import initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig

HAND, HANDLE = (quantity.port for quantity in GRASP_QUANTITIES)
EMPTY = replace(
    initial_grasp(GraspModelConfig()),
    probabilities={kind: float(kind == GraspType.FAILED) for kind in GraspType},
)


def with_hand(record: EpisodeRecord, leaves_at: float = np.inf) -> EpisodeRecord:
    """The hand goes on at 2 cm/s; from `leaves_at` on, the handle stays behind."""
    for tick in record.station:
        way = 0.02 * tick.time
        tick.values[HAND] = RigidTransform([-way, 0.0, 0.5])
        tick.values[HANDLE] = RigidTransform([-min(way, 0.02 * leaves_at), 0.0, 0.5])
    return record


def noticing(record: EpisodeRecord, name: str, at: float) -> EpisodeRecord:
    for tick in record.estimators[name].ticks:
        held = initial_grasp(GraspModelConfig())
        tick.values["grasp_latest"] = EMPTY if tick.time >= at else held
    return record


def test_something_holds_since_the_last_break() -> None:
    times = np.array([1.0, 2.0, 3.0, 4.0])
    assert last_since(times, np.array([True, False, True, True])) == 3.0
    assert last_since(times, np.array([True] * 4)) == 1.0
    assert last_since(times, np.array([True, True, True, False])) == np.inf
    assert last_since(times[:0], np.zeros(0, dtype=bool)) == np.inf


def test_a_bar_may_slide_along_itself_but_not_across() -> None:
    X_WHand = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [1.0, 0.0, 0.5])
    bar = RigidTransform(RollPitchYaw(0.0, 0.0, 0.7), [0.0, 0.0, 0.1])
    moved = [RigidTransform(), RigidTransform([0.0, 0.1, 0.0]), RigidTransform([0.03, 0.1, 0.04])]
    handles = np.array([(X_WHand @ bar @ X).GetAsMatrix4() for X in moved])
    hands = np.tile(X_WHand.GetAsMatrix4(), (3, 1, 1))
    assert_allclose(bar_shift(hands, handles), [0.0, 0.0, 0.05], atol=1e-12)


def test_a_hand_that_keeps_its_bar_has_nothing_to_tell() -> None:
    grasp = grasp_episode(with_hand(synthetic_episode()))
    assert grasp.closed_at == pytest.approx(GRASP_TIME, abs=0.1)
    assert grasp.held_until == grasp.lost_at == np.inf
    assert grasp_lines(summarise_grasp(grasp)) == []


def test_a_bar_that_stays_behind_left_the_hand_when_it_was_far_enough() -> None:
    record = noticing(with_hand(synthetic_episode(), leaves_at=9.0), "crossmodal", 9.5)
    grasp = grasp_episode(record)
    assert grasp.held_until == pytest.approx(9.0 + 0.035 / 0.02, abs=0.1)
    assert grasp.noticed_at["crossmodal"] == pytest.approx(9.5, abs=0.1)
    assert grasp_lines(summarise_grasp(grasp)) == [
        "the handle left it at 10.8 s",
        "found lost by cross-modal at 9.5 s",
    ]


def test_a_joint_that_went_where_it_should_without_the_hand_is_no_success() -> None:
    record = with_hand(synthetic_episode(), leaves_at=9.0)
    assert evaluate(with_hand(synthetic_episode())).success
    results = evaluate(record)
    assert results.success is False
    assert (
        results.failure == "the handle was out of the grip from 10.8 s on, wherever the joint went"
    )
    assert results.summary["grasp"]["held_until_true"] == pytest.approx(10.8, abs=0.1)


def test_a_grasp_that_the_robot_gave_up_is_no_success() -> None:
    record = with_hand(synthetic_episode())
    record.events.append(Event(time=12.0, name=GRASP_LOST))
    assert (
        evaluate(record).failure
        == "the handle was out of the grip from 12.0 s on, wherever the joint went"
    )
    assert set(grasp_episode(record).noticed_at.values()) == {12.0}


def test_nobody_is_said_to_have_noticed_what_nobody_did() -> None:
    grasp = grasp_episode(with_hand(synthetic_episode(), leaves_at=9.0))
    assert grasp_lines(summarise_grasp(grasp))[-1] == "nobody noticed"


def test_without_truth_nothing_is_known_of_the_hand() -> None:
    grasp = grasp_episode(synthetic_episode())
    assert np.isnan(grasp.held_until)
    assert grasp.lost_at == np.inf
    assert summarise_grasp(grasp)["held_until_true"] is None
    assert np.isnan(grasp_episode(empty_episode()).closed_at)
