"""What the robot did and how far that truly moved the joint."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crossmodal.controllers.interaction.phases import Phase as ControlPhase
from crossmodal.diagrams.crossmodal.objects.object_model import read_object_model
from crossmodal.diagrams.crossmodal.scenario import Scenario, Task, object_model_file
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.record import EpisodeRecord, Event, TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import JointType

_DEGREES = 180.0 / np.pi
GRASP_LOST = "grasp lost"
STUCK = "nothing moved although the hand held on: locked or too heavy"
_STATUS = {
    ControlPhase.RELEASE: TaskStatus(phase="releasing", note="grasp lost, trying again"),
    ControlPhase.APPROACH: TaskStatus(),
    ControlPhase.CLOSE: TaskStatus(phase="closing"),
    ControlPhase.EXPLORE: TaskStatus(phase="exploring"),
    ControlPhase.RETURN: TaskStatus(phase="returning"),
    ControlPhase.STOP: TaskStatus(phase="stopped", done=True),
}
_STOPPED_WITHOUT = TaskStatus(phase="stopped", done=True, note=GRASP_LOST)
_STUCK = TaskStatus(phase="stopped", done=True, note=STUCK)


@dataclass(kw_only=True)
class Phase:
    """A part of the task: the joint's target travel and what it truly reached, [m or rad]."""

    target: float
    reached: float


def task_status(phase: Array, grasp_lost: Array, stuck: Array) -> TaskStatus:
    """What a phase of the control means to the task.

    Args:
        phase: (1,) `crossmodal.controllers.interaction.phases.Phase`.
        grasp_lost: (1,) one once a grasp is given up.
        stuck: (1,) one once nothing has moved although the hand held on.
    """
    if stuck[0] > 0.5:
        return _STUCK
    control = ControlPhase(int(phase[0]))
    stopped = control == ControlPhase.STOP and grasp_lost[0] > 0.5
    return _STOPPED_WITHOUT if stopped else _STATUS[control]


def begun(events: Sequence[Event], phase: ControlPhase) -> list[float]:
    """When a phase began, each time, [s]."""
    return [event.time for event in events if event.name == _STATUS[phase].event]


def turning_time(events: Sequence[Event]) -> float:
    """By when the joint has turned: half a second after the return began, [s]; else infinite."""
    returns = begun(events, ControlPhase.RETURN)
    return returns[0] + 0.5 if returns else float("inf")


def task_phases(task: Task, truth: Truth, events: Sequence[Event]) -> dict[str, Phase]:
    """Target and true travel of exploration and exploitation, [m or rad].

    Exploration reaches its turning point: the largest travel up to half a second after the return
    began, or up to the end without one. Exploitation reaches where the joint is at the end. Where
    the truth is not known, what was reached is NaN.
    """
    opening = truth.opening()
    if task.goal is None:
        reached = float(abs(opening[-1])) if len(opening) else float("nan")
        return {"exploration": Phase(target=task.opening, reached=reached)}
    returns = begun(events, ControlPhase.RETURN)
    travel = np.abs(opening[truth.times <= turning_time(events)])
    reached = float(np.nanmax(travel, initial=0.0)) if len(opening) else float("nan")
    phases = {"exploration": Phase(target=task.goal, reached=reached)}
    if task.return_to_start:
        end = float(abs(opening[-1])) if returns and len(opening) else float("nan")
        phases["exploitation"] = Phase(target=0.0, reached=end)
    return phases


def can_be_judged(task: Task, truth: Truth, record: EpisodeRecord) -> bool:
    """Whether a record holds what a verdict needs: the truth, and when the robot turned back."""
    known = any(STATUS_PORT in tick.values for tick in record.station)
    return truth.joint_type is not None and (task.goal is None or known)


def task_failure(
    task: Task, truth: Truth, events: Sequence[Event], lost_at: float = float("inf")
) -> str | None:
    """Why the task was not done, in one line; None where it was, or where nobody can know.

    Args:
        task: What was to be done.
        truth: Of the joint.
        events: Of the robot's own.
        lost_at: From when on the hand held nothing, [s]; a joint that it moved nevertheless, as one
            pushes, was not manipulated.
    """
    if truth.joint_type is None:
        return None
    failure = _travel_failure(task, truth, events)
    if np.isinf(lost_at):
        return failure
    lost = f"the handle was out of the grip from {lost_at:.1f} s on"
    if failure is None:
        return f"{lost}, wherever the joint went"
    return failure if any(event.name == GRASP_LOST for event in events) else f"{failure}; {lost}"


def _travel_failure(task: Task, truth: Truth, events: Sequence[Event]) -> str | None:
    """Why the joint is not where it was to be, in one line."""
    phases = task_phases(task, truth, events)
    reached = phases["exploration"].reached
    lost = [event.time for event in events if event.name == GRASP_LOST]
    after = f"; the grasp was believed lost at {lost[0]:.1f} s" if lost else ""
    if any(event.name == STUCK for event in events):
        after += f"; {STUCK}"
    over = "" if lost or begun(events, ControlPhase.STOP) else " when the time was over"

    def written(value: float, digits: str = ".1f") -> str:
        scale, unit = _readable(truth.joint_type)
        return f"{scale * value:{digits}} {unit}"

    if task.goal is None:
        if reached >= task.opening:
            return None
        asked = written(task.opening, ".3g")
        return f"opened {written(reached)} of the {asked} asked for{over}{after}"
    if abs(reached - task.goal) > task.tolerance:
        goal = written(task.goal, ".3g")
        return f"exploration ended at {written(reached)}{over}, the goal is {goal}{after}"
    if not task.return_to_start:
        return None
    if not begun(events, ControlPhase.RETURN):
        return f"exploration did not end in time{after}"
    if not after and not begun(events, ControlPhase.STOP):
        return "the return did not end in time"
    end = phases["exploitation"].reached
    if end > task.tolerance:
        enough = written(task.tolerance, ".3g")
        return f"brought back to {written(end)} from its start, {enough} is near enough{after}"
    return None


def _readable(joint_type: JointType | None) -> tuple[float, str]:
    """Factor and unit in which a joint's travel is written."""
    return (100.0, "cm") if joint_type == JointType.PRISMATIC else (_DEGREES, "deg")


def task_in_words(scenario: Scenario) -> str:
    """What counts as done, with its tolerances."""
    task, thing = scenario.task, scenario.object
    facts = read_object_model(
        object_model_file(thing), joint=thing.joint, frame=thing.handle_frame, source=scenario.name
    )
    scale, unit = _readable(facts.joint_type)

    def written(value: float) -> str:
        return f"{scale * value:.3g} {unit}"

    if task.goal is None:
        return f"Done: the joint has truly gone {written(task.opening)} or more at the end."
    words = (
        f"Done: the exploration has truly ended within {written(task.tolerance)} of"
        f" {written(task.goal)}"
    )
    if task.return_to_start:
        words += f", and the joint is back within {written(task.tolerance)} of its start"
    if thing.initial_position:
        words += f". It starts {written(thing.initial_position)} open"
    return words + "."
