"""Parts are connected by the names of their ports."""

import numpy as np
from numpy.testing import assert_array_equal
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from crossmodal.diagrams.stations.connections import (
    connect,
    connect_alike,
    export_input,
    export_outputs,
)


class Relay(LeafSystem):
    """Passes on what it hears, times its gain."""

    def __init__(self, gain: float) -> None:
        super().__init__()
        self._gain, self._port = gain, self.DeclareVectorInputPort("signal", 1)
        self.DeclareVectorOutputPort("signal", 1, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._gain * np.asarray(self._port.Eval(context)))


def test_one_input_reaches_all_and_outputs_keep_their_names() -> None:
    builder = DiagramBuilder()
    first, second, third = (builder.AddSystem(Relay(gain)) for gain in (2.0, 3.0, 5.0))
    export_input(builder, "signal", first)
    connect_alike(builder, first, "signal", second)
    connect(builder, [(second, "signal", third, "signal")])
    export_outputs(builder, third, "signal")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("signal").FixValue(context, 1.0)
    assert_array_equal(diagram.GetOutputPort("signal").Eval(context), [30.0])


def test_an_exported_input_is_one_for_all_of_its_parts() -> None:
    builder = DiagramBuilder()
    parts = [builder.AddSystem(Relay(gain)) for gain in (2.0, 3.0)]
    export_input(builder, "signal", *parts)
    export_outputs(builder, parts[1], "signal")
    diagram = builder.Build()
    assert diagram.num_input_ports() == 1
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, 4.0)
    assert_array_equal(diagram.get_output_port().Eval(context), [12.0])
