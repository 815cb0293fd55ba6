"""What the robot says that it does with the flap."""

from pydrake.common.value import AbstractValue

from controllers.servoing.flip_decisions import FlipPhase
from diagrams.flap.flip_status import FLIPPING, FlipStatus, flip_status
from diagrams.run.record import TaskStatus


def test_only_the_last_phases_end_the_episode():
    done = {phase for phase in FlipPhase if flip_status(phase, "").done}
    assert done == {FlipPhase.DONE, FlipPhase.FAILED}
    assert flip_status(FlipPhase.FLIP, "").phase == FLIPPING


def test_a_failure_says_why():
    assert flip_status(FlipPhase.FAILED, "contact lost").event == "contact lost"


def test_the_system_reads_phase_and_failure():
    system = FlipStatus()
    context = system.CreateDefaultContext()
    system.GetInputPort("phase").FixValue(context, [float(FlipPhase.FAILED)])
    system.GetInputPort("failure").FixValue(context, AbstractValue.Make("out of reach"))
    status = system.get_output_port().Eval(context)
    assert status == TaskStatus(phase="stopped", done=True, note="out of reach")
