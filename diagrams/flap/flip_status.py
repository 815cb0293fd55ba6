"""What the robot does with the flap and the tool, in the words of the task."""

from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import LinePhase
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.maths.arrays import Array

FLIPPING, RETREATING, DONE = "flipping", "retreating", "done"
TO_TABLE, ON_LINE = "to the table", "line on the table"
_FLIP = {
    FlipPhase.PRE_CONTACT: TaskStatus(phase="approaching"),
    FlipPhase.ESTABLISH_CONTACT: TaskStatus(phase="touching"),
    FlipPhase.FLIP: TaskStatus(phase=FLIPPING),
    FlipPhase.RETREAT: TaskStatus(phase=RETREATING),
}
_LINE = {
    LinePhase.WAIT: _FLIP[FlipPhase.RETREAT],
    LinePhase.APPROACH: TaskStatus(phase=TO_TABLE),
    LinePhase.LOWER: TaskStatus(phase=TO_TABLE),
    LinePhase.LINE: TaskStatus(phase=ON_LINE),
    LinePhase.DONE: TaskStatus(phase=DONE, done=True),
}


def flip_status(
    flip_phase: Array, flip_failure: str, line_phase: Array, line_failure: str
) -> TaskStatus:
    """What the phases of both arms mean to the task.

    Args:
        flip_phase: (1,) `FlipPhase`, what the finger does.
        flip_failure: Why it failed; empty if it has not.
        line_phase: (1,) `LinePhase`, what the arm with the tool does.
        line_failure: Why it does not follow the line; empty if it does.
    """
    flip, line = FlipPhase(int(flip_phase[0])), LinePhase(int(line_phase[0]))
    if flip == FlipPhase.FAILED:
        return TaskStatus(phase="stopped", done=True, note=flip_failure)
    if flip != FlipPhase.DONE:
        return _FLIP[flip]
    if line == LinePhase.FAILED:
        return TaskStatus(phase="stopped", done=True, note=line_failure)
    return _LINE[line]
