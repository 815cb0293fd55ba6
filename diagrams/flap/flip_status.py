"""What the robot does with the flap and the tool, in the words of the task."""

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem

from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import LinePhase
from crossmodal.diagrams.run.record import TaskStatus

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


def flip_status(flip: FlipPhase, flip_failure: str, line: LinePhase, failure: str) -> TaskStatus:
    """What the phases of both arms mean to the task.

    Args:
        flip: What the finger does.
        flip_failure: Why it failed; empty if it has not.
        line: What the arm with the tool does.
        failure: Why it does not follow the line; empty if it does.
    """
    if flip == FlipPhase.FAILED:
        return TaskStatus(phase="stopped", done=True, note=flip_failure)
    if flip != FlipPhase.DONE:
        return _FLIP[flip]
    if line == LinePhase.FAILED:
        return TaskStatus(phase="stopped", done=True, note=failure)
    return _LINE[line]


class FlipStatus(LeafSystem):
    """Says in the words of the task what finger and tool do.

    Input ports:
    - `flip_phase`: (1,) `FlipPhase`.
    - `flip_failure`: str, why it failed; empty if it has not.
    - `line_phase`: (1,) `LinePhase`.
    - `line_failure`: str, likewise.

    Output ports:
    - `task_status`: `TaskStatus`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._flip, self._line = (
            (
                self.DeclareVectorInputPort(f"{name}_phase", 1),
                self.DeclareAbstractInputPort(f"{name}_failure", AbstractValue.Make("")),
            )
            for name in ("flip", "line")
        )
        self.DeclareAbstractOutputPort(
            "task_status", lambda: Value[object](TaskStatus()), self._calc_status
        )

    def _calc_status(self, context: Context, output: Value) -> None:
        flip, flip_failure = (port.Eval(context) for port in self._flip)
        line, line_failure = (port.Eval(context) for port in self._line)
        output.set_value(
            flip_status(
                FlipPhase(int(flip[0])), flip_failure, LinePhase(int(line[0])), line_failure
            )
        )
