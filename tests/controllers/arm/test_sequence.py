"""A sequence's state follows from itself at a fixed period, and outputs are functions of it."""

import pytest
from known_arm import STILL, arm_model
from numpy.testing import assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.sequence import Sequence, read


class Counter(Sequence):
    """Counts its updates."""

    def __init__(self, arm: ArmModel) -> None:
        super().__init__(arm)
        self.step = self.DeclareVectorInputPort("step", 1)
        self._declare_state(0, 0.1)
        self._declare_vector("count", 1, self._state, self._on_state)
        self._declare_value("word", "", lambda context: "n" * self._state(context))

    def _next(self, context: Context) -> int:
        return int(self._state(context)) + int(read(self.step, context, 2.0)[0])


@pytest.mark.parametrize(("given", "count"), [(None, 6), (1.0, 3)])
def test_it_updates_at_its_period_and_reads_what_is_connected(
    given: float | None, count: int
) -> None:
    counter = Counter(arm_model())
    simulator = Simulator(counter)
    context = simulator.get_mutable_context()
    counter.GetInputPort("joint_state_measured").FixValue(context, STILL)
    if given is not None:
        counter.step.FixValue(context, given)
    simulator.AdvanceTo(0.25)
    assert_array_equal(counter.GetOutputPort("count").Eval(context), [count])
    assert counter.GetOutputPort("word").Eval(context) == "n" * count
