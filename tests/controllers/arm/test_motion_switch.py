"""Who commands the arm, instant by instant."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from crossmodal.controllers.arm.impedance import NO_GAINS, NO_MOTION, DesiredMotion, ImpedanceGains
from crossmodal.controllers.arm.motion_switch import MotionSwitch

NAMES = ("first", "second", "third")
SOFT = ImpedanceGains(stiffness=np.eye(6), damping=np.eye(6), mass=np.eye(6))


def motion(x: float) -> DesiredMotion:
    """A pose that is x beside the origin, and recognised by it."""
    X_WE = np.eye(4)
    X_WE[0, 3] = x
    return DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))


A, B, C = motion(1.0), motion(2.0), motion(3.0)


def switch_with(**values: object) -> tuple[object, object]:
    """Motion and gains that come out, by the inputs that are connected."""
    switch = MotionSwitch(NAMES)
    context = switch.CreateDefaultContext()
    for port, value in values.items():
        switch.GetInputPort(f"{port}_desired").FixValue(context, Value[object](value))
    outputs = ("motion_commanded", "gains_commanded")
    commanded, gains = (switch.GetOutputPort(name).Eval(context) for name in outputs)
    return commanded, gains


def test_the_last_source_that_has_a_motion_commands() -> None:
    assert switch_with(first_motion=A, second_motion=B, third_motion=NO_MOTION)[0] is B
    assert switch_with(first_motion=A, second_motion=B, third_motion=C)[0] is C
    assert switch_with(first_motion=A, third_motion=NO_MOTION)[0] is A


def test_a_source_without_gains_leaves_them_to_those_before_it() -> None:
    assert switch_with(first_motion=A, first_gains=SOFT, second_motion=B) == (B, SOFT)
    assert switch_with(first_motion=A, first_gains=SOFT, second_gains=NO_GAINS) == (A, SOFT)


def test_without_any_source_there_is_no_motion() -> None:
    assert switch_with() == (NO_MOTION, NO_GAINS)


class Clock(LeafSystem):
    """Its motion is the time of its update."""

    def __init__(self, period: float) -> None:
        super().__init__()
        state = self.DeclareAbstractState(Value[object](motion(0.0)))
        self.DeclareStateOutputPort("motion_desired", state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(0).set_value(motion(context.get_time()))


class Successor(LeafSystem):
    """From `start` to `end` it goes on from the motion that it finds, by 100 m an update."""

    def __init__(self, period: float, start: float, end: float) -> None:
        super().__init__()
        self._start, self._end = start, end
        self._commanded = self.DeclareAbstractInputPort(
            "motion_commanded", Value[object](NO_MOTION)
        )
        state = self.DeclareAbstractState(Value[object](NO_MOTION))
        self.DeclareStateOutputPort("motion_desired", state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        last = context.get_abstract_state(0).get_value()
        last = last if last.exists else self._commanded.Eval(context)
        active = self._start <= context.get_time() < self._end
        following = motion(last.X_WE[0, 3] + 100.0) if active else NO_MOTION
        state.get_mutable_abstract_state(0).set_value(following)


def test_a_successor_goes_on_from_the_motion_before_it_and_gives_way_without_a_gap() -> None:
    builder = DiagramBuilder()
    switch = builder.AddSystem(MotionSwitch(("clock", "successor")))
    clock, successor = builder.AddSystem(Clock(1.0)), builder.AddSystem(Successor(1.0, 2.0, 4.0))
    builder.Connect(switch.GetOutputPort("motion_commanded"), successor.get_input_port())
    for name, source in (("clock", clock), ("successor", successor)):
        builder.Connect(source.get_output_port(), switch.GetInputPort(f"{name}_motion_desired"))
    simulator = Simulator(builder.Build())
    commanded = []
    for time in range(6):
        simulator.AdvanceTo(time + 0.5)
        context = switch.GetMyContextFromRoot(simulator.get_context())
        commanded.append(switch.GetOutputPort("motion_commanded").Eval(context).X_WE[0, 3])
    np.testing.assert_allclose(commanded, [0.0, 1.0, 101.0, 201.0, 4.0, 5.0])
