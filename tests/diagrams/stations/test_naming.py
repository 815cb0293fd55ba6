import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource

from crossmodal.diagrams.stations.naming import estimator_of, own_seed, owner_among, prefixed


def test_the_only_one_needs_no_name() -> None:
    assert prefixed(owner_among("head", ["head"]), "color_measured") == "color_measured"
    assert own_seed(3, owner_among("head", ["head"])) == 3


def test_one_of_several_has_names_and_seed_of_its_own() -> None:
    both = ["left", "right"]
    assert prefixed(owner_among("left", both), "wrench_window") == "left_wrench_window"
    assert len({3, *(own_seed(3, owner_among(name, both)) for name in both)}) == 3


def test_an_estimator_of_one_hears_its_ports_and_speaks_by_its_own_names() -> None:
    adder = Adder(2, 1)
    names = [adder.get_input_port(index).get_name() for index in range(2)]
    estimator = estimator_of("left", adder, names)
    inputs = [estimator.get_input_port(index).get_name() for index in range(2)]
    assert inputs == [f"left_{name}" for name in names]
    builder = DiagramBuilder()
    builder.AddSystem(estimator)
    for value, name in enumerate(inputs, start=1):
        source = builder.AddSystem(ConstantVectorSource([float(value)]))
        builder.Connect(source.get_output_port(), estimator.GetInputPort(name))
    port = adder.get_output_port().get_name()
    builder.ExportOutput(estimator.GetOutputPort(port), "sum")
    diagram = builder.Build()
    assert np.asarray(diagram.GetOutputPort("sum").Eval(diagram.CreateDefaultContext())) == [3.0]


def test_inputs_that_the_station_lacks_stay_unconnected() -> None:
    adder = Adder(2, 1)
    estimator = estimator_of("left", adder, [adder.get_input_port(0).get_name()])
    assert estimator.num_input_ports() == 1
