"""A filter of one's own takes the place of ours, or is told which of its ports does not fit."""

import re
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.application import APPLICATION as CLUTTER
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.estimators import make_network
from crossmodal.diagrams.stations.filters import Filters, fitted
from crossmodal.systems.pose.pose_estimators import PoseEstimator
from crossmodal.systems.proprioception.hand_bending import HandBending
from crossmodal.systems.recursive_filter import RecursiveFilter


class Ours(RecursiveFilter):
    """Adds what it reads, `gain` times."""

    def __init__(self, gain: float, *, offset: float = 0.0) -> None:
        super().__init__()
        self.gain = gain
        self.inputs = {name: self.DeclareVectorInputPort(name, n) for name, n in self.reads()}
        self._declare_recursion((offset,), self._add, 0.1)
        self.declare_outputs()

    def reads(self) -> list[tuple[str, int]]:
        return [("wrench", 6), ("active", 1)]

    def declare_outputs(self) -> None:
        self._declare_estimated("sum_estimated", self.value)
        self._declare_latest("sum_latest", self.value)

    def value(self, state: Any) -> Any:
        return float(state[0])

    def _add(self, context: Any, state: Any) -> Any:
        read = [self._read_optional(port, context) for port in self.inputs.values()]
        return (state[0] + self.gain * sum(float(np.sum(value)) for value in read),)


class WithoutWrench(Ours):
    def reads(self) -> list[tuple[str, int]]:
        return [("active", 1)]


class Misnamed(Ours):
    def reads(self) -> list[tuple[str, int]]:
        return [("wrensh", 6)]


class TooShort(Ours):
    def reads(self) -> list[tuple[str, int]]:
        return [("wrench", 3)]


class WithoutLatest(Ours):
    def declare_outputs(self) -> None:
        self._declare_estimated("sum_estimated", self.value)
        self._declare_latest("sum_lates", self.value)


class AnotherType(Ours):
    def value(self, state: Any) -> Any:
        return str(state[0])


class NotFromTheState(Ours):
    def declare_outputs(self) -> None:
        self._declare_estimated("sum_estimated", self.value)
        self._declare_estimated("sum_latest", self.value)


class WithoutArguments(Ours):
    def __init__(self) -> None:
        super().__init__(1.0)


def no_system(gain: float, offset: float) -> str:
    return "none"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Misnamed, "(Misnamed): reads 'wrensh', which a Ours in its place is not given;"
                   " did you mean 'wrench'? allowed: active, wrench"),
        (TooShort, "(TooShort): input 'wrench' is a vector of 3, but it must be a vector of 6"),
        (WithoutLatest, "(WithoutLatest): has no output 'sum_latest', which others read;"
                        " did you mean 'sum_lates'? it has: sum_estimated, sum_lates"),
        (AnotherType, "'sum_estimated' is abstract, a str, but it must be abstract, a float"),
        (NotFromTheState, "output 'sum_latest' must be from the state alone"),
        (WithoutArguments, "is called as Ours is, with (float, offset=):"),
        (no_system, "(no_system): must be a Drake System, not a str"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_its_port_and_those_that_there_are(
    make: Any, message: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        fitted("adder", make, Ours(2.0, offset=1.0), 2.0, offset=1.0)
    assert str(caught.value).startswith(f"filter 'adder' ({make.__name__})")


@pytest.mark.parametrize(("make", "total"), [(Ours, 1.0 + 2.0 * 7.0), (WithoutWrench, 3.0)])
def test_one_that_reads_only_some_inputs_is_connected_as_ours_is(make: Any, total: float) -> None:
    builder = DiagramBuilder()
    adder = Filters({"adder": make}).add(builder, "adder", Ours, 2.0, offset=1.0)
    for name, size in (("wrench", 6), ("active", 1)):
        source = builder.AddSystem(ConstantVectorSource(np.ones(size)))
        builder.Connect(source.get_output_port(), adder.GetInputPort(name))
    builder.ExportOutput(adder.GetOutputPort("sum_estimated"), "sum")
    diagram = builder.Build()
    assert diagram.GetSubsystemByName("adder") is not None
    assert diagram.GetOutputPort("sum").Eval(diagram.CreateDefaultContext()) == total


def test_a_filter_that_there_is_not_is_named_with_those_that_there_are() -> None:
    filters = Filters({"addre": Ours})
    assert type(filters.make("adder", Ours, 1.0)) is Ours
    with pytest.raises(ValueError, match="'mine' has no filter 'addre'; did you mean 'adder'"):
        filters.check("mine")


class Bending(HandBending):
    pass


class Blind(LeafSystem):
    def __init__(self, config: Any) -> None:
        super().__init__()
        self.DeclareVectorInputPort("interaction_active", 1)
        self.DeclareAbstractOutputPort("hand_bending_estimate", *_nothing())


def _nothing() -> tuple[Any, Any]:
    from pydrake.common.value import Value

    return lambda: Value[object](0), lambda context, value: None


def network(modality: str, **replacements: Any) -> System:
    _, scenario = load_scenario("drawer")
    calibration = APPLICATION.make_calibration(scenario)
    return make_network(
        modality, scenario.perception, calibration, 1 / 15, replacements=replacements
    )


def test_a_network_has_ones_own_filter_where_ours_was() -> None:
    made = network("proprioception", hand_bending=Bending)
    assert isinstance(made.GetSubsystemByName("hand_bending"), Bending)


def test_a_network_names_the_port_that_a_filter_of_ones_own_lacks() -> None:
    message = r"'hand_bending' \(Blind\): has no output 'hand_bending_estimated'.*did you mean"
    with pytest.raises(ValueError, match=message):
        network("proprioception", hand_bending=Blind)
    with pytest.raises(ValueError, match=r"'vision' has no filter 'hand_bending';.*camera_motion"):
        network("vision", hand_bending=Bending)


class Pose(PoseEstimator):
    pass


def test_the_pose_estimator_of_the_clutter_can_be_replaced(tmp_path: Any) -> None:
    changes = [
        "variants.mine.of=density",
        f"variants.mine.replacements.pose_estimator={__file__}:Pose",
    ]
    _, scenario = load_scenario("pose-estimation", changes)
    estimators = CLUTTER.make_estimators(scenario, CLUTTER.make_calibration(scenario))
    assert list(estimators) == [*load_scenario("pose-estimation")[1].modalities, "mine"]
    assert type(estimators["mine"]).__name__ == "Pose"
