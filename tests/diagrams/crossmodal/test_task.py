"""What a task with a goal came to, from events and truth; and one such episode, short."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from controllers.interaction.phases import Phase as ControlPhase
from diagrams.crossmodal.scenario import Task, load_scenario
from diagrams.crossmodal.task import event_name, task_failure, task_phases
from diagrams.run.episode import run_episode
from diagrams.run.record import Event, Truth
from diagrams.run.yaml_schema import ScenarioError
from systems.port_values import JointType

TASK = Task(goal=0.2, return_to_start=True, tolerance=0.05)


def truth(*opening: float) -> Truth:
    """One opening per second, grasped at the first."""
    return Truth(
        joint_name="slide",
        joint_type=JointType.PRISMATIC,
        axis_W=np.array([1.0, 0.0, 0.0]),
        point_W=np.zeros(3),
        times=np.arange(len(opening), dtype=float),
        configuration=np.array(opening),
        X_WB=np.tile(np.eye(4), (len(opening), 1, 1)),
        grasp_time=0.0,
    )


def events(*phases: tuple[float, ControlPhase], lost: bool = False) -> list[Event]:
    return [Event(time=time, name=str(event_name(phase, lost))) for time, phase in phases]


DONE = events((0.0, ControlPhase.EXPLORE), (2.0, ControlPhase.RETURN), (4.0, ControlPhase.STOP))


def test_exploration_counts_at_its_turning_point_and_exploitation_at_the_end() -> None:
    phases = task_phases(TASK, truth(0.0, 0.1, 0.21, 0.1, 0.01), DONE)
    assert (phases["exploration"].target, phases["exploration"].reached) == (0.2, 0.21)
    assert_allclose(phases["exploitation"].reached, 0.01)
    assert task_failure(TASK, truth(0.0, 0.1, 0.21, 0.1, 0.01), DONE) is None


@pytest.mark.parametrize(
    ("opening", "what", "why"),
    [
        ((0.0, 0.1, 0.12, 0.1, 0.0), DONE, "exploration ended at 0.120"),
        ((0.0, 0.1, 0.2, 0.1, 0.08), DONE, "brought back to 0.080"),
        ((0.0, 0.1, 0.2, 0.1, 0.0), DONE[:2], "the return did not end"),
        ((0.0, 0.1, 0.2), DONE[:1], "exploration did not end"),
        (
            (0.0, 0.1, 0.1),
            events((2.0, ControlPhase.STOP), lost=True),
            "exploration ended at 0.100, the goal is 0.2; the grasp was believed lost at 2.0 s",
        ),
    ],
)
def test_what_was_not_done_is_said(opening: tuple[float, ...], what: list[Event], why: str) -> None:
    assert why in str(task_failure(TASK, truth(*opening), what))


def test_a_mere_exploration_says_too_that_the_grasp_was_lost() -> None:
    lost = events((2.0, ControlPhase.STOP), lost=True)
    failure = task_failure(Task(opening=0.2), truth(0.0, 0.1, 0.0), lost)
    assert failure == "opened 0.000 of the 0.2 asked for; the grasp was believed lost at 2.0 s"
    assert task_failure(Task(opening=0.2), truth(0.0, 0.1, 0.2), lost) is None


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
    scenario = load_scenario("drawer-return", ["task.goal=0.04", "modalities=[crossmodal]"])
    result = run_episode(scenario, 7)
    assert result.failure is None
    names = [event.name for event in result.events]
    assert names == ["closing", "exploring", "returning", "stopped"]
    assert abs(result.phases["exploration"].reached - 0.04) < 0.004
    assert abs(result.phases["exploitation"].reached) < 0.004
