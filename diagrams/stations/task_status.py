"""What a robot does, in the words of its task."""

from collections.abc import Callable, Mapping

from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort

from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT, declare_input, read_inputs
from crossmodal.diagrams.run.sensor_streams.stream_faults import model_of


class TaskStatusSource(LeafSystem):
    """Says in the words of the task what the controllers do.

    Input ports:
    - `<quantity>`: what the controllers say of themselves.

    Output ports:
    - `task_status`: `TaskStatus`.

    Args:
        status: From the values of the inputs, by their names.
        quantities: The outputs of the controllers that become inputs, by these names.
    """

    def __init__(
        self, status: Callable[..., TaskStatus], quantities: Mapping[str, OutputPort]
    ) -> None:
        super().__init__()
        ports = {name: declare_input(self, name, model_of(q)) for name, q in quantities.items()}

        def calc(context: Context, output: Value) -> None:
            output.set_value(status(**read_inputs(ports, context)))

        self.DeclareAbstractOutputPort(STATUS_PORT, lambda: Value[object](TaskStatus()), calc)


def add_task_status(
    builder: DiagramBuilder, status: Callable[..., TaskStatus], quantities: Mapping[str, OutputPort]
) -> None:
    """Adds a `TaskStatusSource`, connects it and exports `task_status`."""
    source = builder.AddNamedSystem(STATUS_PORT, TaskStatusSource(status, quantities))
    for name, port in quantities.items():
        builder.Connect(port, source.GetInputPort(name))
    builder.ExportOutput(source.get_output_port(), STATUS_PORT)
