"""What the robot does with the flap, in the words of the task."""

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem

from controllers.servoing.flip_decisions import FlipPhase
from diagrams.run.record import TaskStatus

FLIPPING = "flipping"
_STATUS = {
    FlipPhase.PRE_CONTACT: TaskStatus(phase="approaching"),
    FlipPhase.ESTABLISH_CONTACT: TaskStatus(phase="touching"),
    FlipPhase.FLIP: TaskStatus(phase=FLIPPING),
    FlipPhase.DONE: TaskStatus(phase="done", done=True),
}


def flip_status(phase: FlipPhase, failure: str) -> TaskStatus:
    """What a phase of the control means to the task."""
    if phase == FlipPhase.FAILED:
        return TaskStatus(phase="stopped", done=True, note=failure)
    return _STATUS[phase]


class FlipStatus(LeafSystem):
    """Says in the words of the task what the flip sequence does.

    .. pydrake_system::

        name: FlipStatus
        input_ports:
        - phase
        - failure
        output_ports:
        - task_status

    - phase: (1,) `FlipPhase`.
    - failure: str, why it failed; empty if it has not.
    - task_status: `TaskStatus`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._failure = self.DeclareAbstractInputPort("failure", AbstractValue.Make(""))
        self.DeclareAbstractOutputPort(
            "task_status", lambda: Value[object](TaskStatus()), self._calc_status
        )

    def _calc_status(self, context: Context, output: Value) -> None:
        phase = FlipPhase(int(self._phase.Eval(context)[0]))
        output.set_value(flip_status(phase, self._failure.Eval(context)))
