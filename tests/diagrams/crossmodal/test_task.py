"""What a task with a goal came to, from events and truth; and one such episode, short."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_episode import synthetic_episode

from crossmodal.controllers.interaction.phases import Phase as ControlPhase
from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.crossmodal.scenario import Task
from crossmodal.diagrams.crossmodal.task import (
    task_failure,
    task_phases,
    task_status,
)
from crossmodal.diagrams.joints.joint_truth import UNKNOWN_JOINT, Truth
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.record import Event, TaskStatus
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import JointType

TASK = Task(goal=0.2, return_to_start=True, tolerance=0.05)


def truth(*opening: float) -> Truth:
    """One opening per second, grasped at the first."""
    return Truth(
        name="slide",
        type=JointType.PRISMATIC,
        axis_W=np.array([1.0, 0.0, 0.0]),
        point_W=np.zeros(3),
        times=np.arange(len(opening), dtype=float),
        configuration=np.array(opening),
        X_WB=np.tile(np.eye(4), (len(opening), 1, 1)),
        grasp_time=0.0,
    )


def events(*phases: tuple[float, ControlPhase], lost: bool = False) -> list[Event]:
    return [
        Event(time=time, name=task_status(np.array([phase]), np.array([lost]), np.zeros(1)).event)
        for time, phase in phases
    ]


DONE = events((0.0, ControlPhase.EXPLORE), (2.0, ControlPhase.RETURN), (4.0, ControlPhase.STOP))


def test_exploration_counts_at_its_turning_point_and_exploitation_at_the_end() -> None:
    phases = task_phases(TASK, truth(0.0, 0.1, 0.21, 0.1, 0.01), DONE)
    assert (phases["exploration"].target, phases["exploration"].reached) == (0.2, 0.21)
    assert_allclose(phases["exploitation"].reached, 0.01)
    assert task_failure(TASK, truth(0.0, 0.1, 0.21, 0.1, 0.01), DONE) is None


@pytest.mark.parametrize(
    ("opening", "what", "why"),
    [
        ((0.0, 0.1, 0.12, 0.1, 0.0), DONE, "exploration ended at 12.0 cm, the goal is 20 cm"),
        (
            (0.0, 0.1, 0.2, 0.1, 0.08),
            DONE,
            "brought back to 8.0 cm from its start, 5 cm is near enough",
        ),
        ((0.0, 0.1, 0.2, 0.1, 0.0), DONE[:2], "the return did not end"),
        ((0.0, 0.1, 0.2), DONE[:1], "exploration did not end"),
        (
            (0.0, 0.1, 0.1),
            events((2.0, ControlPhase.STOP), lost=True),
            "exploration ended at 10.0 cm, the goal is 20 cm; the grasp was believed lost at 2.0 s",
        ),
    ],
)
def test_what_was_not_done_is_said(opening: tuple[float, ...], what: list[Event], why: str) -> None:
    assert why in str(task_failure(TASK, truth(*opening), what))


def test_a_mere_exploration_says_too_that_the_grasp_was_lost() -> None:
    lost = events((2.0, ControlPhase.STOP), lost=True)
    failure = task_failure(Task(opening=0.2), truth(0.0, 0.1, 0.0), lost)
    assert failure == "opened 0.0 cm of the 20 cm asked for; the grasp was believed lost at 2.0 s"
    assert task_failure(Task(opening=0.2), truth(0.0, 0.1, 0.2), lost) is None


def test_a_task_that_ran_out_of_time_says_so_in_readable_units() -> None:
    before = events((0.0, ControlPhase.CLOSE))
    cut = " asked for when the time was over"
    assert (
        task_failure(Task(goal=None), truth(0.0, 0.0), before) == f"opened 0.0 cm of the 20 cm{cut}"
    )
    door = replace(truth(0.0, 0.1), type=JointType.REVOLUTE)
    assert task_failure(Task(), door, before) == f"opened 5.7 deg of the 11.5 deg{cut}"
    stopped = events((2.0, ControlPhase.STOP))
    assert (
        task_failure(Task(goal=None), truth(0.0, 0.0), stopped)
        == "opened 0.0 cm of the 20 cm asked for"
    )


@pytest.mark.parametrize("with_truth", [True, False])
@pytest.mark.parametrize("with_status", [True, False])
def test_a_record_without_truth_or_turning_point_is_not_judged(
    with_truth: bool, with_status: bool
) -> None:
    record = synthetic_episode(duration=10.0)
    for tick in record.station:
        kept = {k: v for k, v in tick.values.items() if with_truth or not k.startswith("cheat_")}
        tick.values = kept | ({"task_status": TaskStatus()} if with_status else {})
    opening = evaluate(record)
    assert opening.success is (False if with_truth else None)
    assert (opening.failure is None) is not with_truth
    record.scenario = replace(record.scenario, task=Task(goal=0.2))
    assert evaluate(record).success is (False if with_truth and with_status else None)


def test_where_the_truth_is_unknown_nothing_failed_and_nothing_is_said_to_be_reached() -> None:
    unknown = Truth(
        **vars(UNKNOWN_JOINT), times=np.zeros(0),
        configuration=np.zeros(0), X_WB=np.zeros((0, 4, 4)), grasp_time=1.0,
    )  # fmt: skip
    for task in (TASK, Task(opening=0.2), Task(goal=0.2)):
        assert task_failure(task, unknown, DONE) is None
        phases = task_phases(task, unknown, DONE)
        assert np.all(np.isnan([phase.reached for phase in phases.values()]))


@pytest.mark.parametrize("phase", ControlPhase)
def test_the_station_says_what_a_phase_means_and_only_stopping_ends_it(phase: ControlPhase) -> None:
    for lost in (0.0, 1.0):
        status = task_status(np.array([phase]), np.array([lost]), np.zeros(1))
        assert status.done == (phase == ControlPhase.STOP)
    assert (status.note == "grasp lost") == (phase == ControlPhase.STOP)


def test_a_joint_that_did_not_move_although_the_hand_held_on_is_locked_or_too_heavy() -> None:
    status = task_status(np.array([ControlPhase.STOP]), np.zeros(1), np.ones(1))
    assert status.done
    failure = task_failure(Task(goal=None), truth(0.0, 0.0), [Event(time=9.0, name=status.event)])
    assert failure is not None
    assert failure.endswith("nothing moved although the hand held on: locked or too heavy")


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("task.goal=-0.1", "task.goal = -0.1"),
        ("task.modality=touch", "task.modality = 'touch' is not among the modalities"),
        ("task.tolerance=0", "task.tolerance = 0"),
        ("task.goal=null", "task.return_to_start needs task.goal"),
    ],
)
def test_an_impossible_task_is_refused_by_its_key(assignment: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        load_scenario("drawer-return", [assignment])


def test_the_drawer_is_pulled_to_the_perceived_goal_and_pushed_back() -> None:
    application, scenario = load_scenario(
        "drawer-return", ["seed=7", "task.goal=0.04", "modalities=[crossmodal]"]
    )
    record = run_episode(application, scenario)
    results = application.evaluate(record)
    assert results.failure is None
    names = [event.name for event in record.events]
    assert names == ["closing", "exploring", "returning", "stopped"]
    phases = results.summary["phases"]
    assert abs(phases["exploration"]["reached"] - 0.04) < 0.004
    assert abs(phases["exploitation"]["reached"]) < 0.004
