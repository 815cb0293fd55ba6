"""How the parts of a Diagram are connected by the names of their ports."""

from collections.abc import Iterable

from pydrake.systems.framework import DiagramBuilder, System

Connection = tuple[System, str, System, str]  # From whose output to whose input.


def connect(builder: DiagramBuilder, connections: Iterable[Connection]) -> None:
    """Makes the connections of a Diagram's parts."""
    for source, output, target, port in connections:
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(port))


def connect_alike(builder: DiagramBuilder, source: System, port: str, *targets: System) -> None:
    """Connects an output to the inputs of the same name."""
    connect(builder, [(source, port, target, port) for target in targets])


def export_input(builder: DiagramBuilder, name: str, *targets: System) -> None:
    """Makes the inputs of one name one input of the Diagram."""
    first, *others = (target.GetInputPort(name) for target in targets)
    exported = builder.ExportInput(first, name)
    for port in others:
        builder.ConnectInput(exported, port)


def export_outputs(builder: DiagramBuilder, source: System, *ports: str) -> None:
    """Makes outputs of a part outputs of the Diagram."""
    for port in ports:
        builder.ExportOutput(source.GetOutputPort(port), port)
