"""What the controllers say of themselves reaches the task's words."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.stations.task_status import add_task_status


def stopped(phase: np.ndarray, failure: str) -> TaskStatus:
    return TaskStatus(phase=f"{phase[0]:g}", done=True, note=failure)


def test_numbers_and_texts_are_read() -> None:
    builder = DiagramBuilder()
    phase = builder.AddSystem(ConstantVectorSource([4.0]))
    failure = builder.AddSystem(ConstantValueSource(AbstractValue.Make("far")))
    ports = {"phase": phase.get_output_port(), "failure": failure.get_output_port()}
    add_task_status(builder, stopped, ports)
    diagram = builder.Build()
    status = diagram.GetOutputPort("task_status").Eval(diagram.CreateDefaultContext())
    assert status == TaskStatus(phase="4", done=True, note="far")
