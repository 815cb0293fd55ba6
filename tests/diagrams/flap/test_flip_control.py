"""The flip's controllers fit together, and with the arm that carries the fingertip."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from crossmodal.diagrams.flap.flip_control import (
    FlipControlConfig,
    make_flip_control,
    make_line_control,
)
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP, LWR_WITH_THREE_FINGERS
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.tactile.fingertip_motion import FingertipMotion, FingertipMotionConfig
from crossmodal.systems.tactile.taxel_layout import fingertip_layout
from tests.documented_ports import documented_ports

Q = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])


@pytest.fixture(scope="module")
def control() -> Diagram:
    model = make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())
    return make_flip_control(FlipControlConfig(), model, fingertip_layout(), Q)


@pytest.fixture(scope="module")
def line_control() -> Diagram:
    model = make_arm_with_load(LWR_WITH_THREE_FINGERS, RigidTransform())
    return make_line_control(FlipControlConfig(), model, Q)


def declared(system: System) -> dict[str, set[str]]:
    inputs = range(system.num_input_ports())
    outputs = range(system.num_output_ports())
    return {
        "input": {system.get_input_port(i).get_name() for i in inputs},
        "output": {system.get_output_port(i).get_name() for i in outputs},
    }


def test_every_system_has_the_ports_that_it_documents(
    control: Diagram, line_control: Diagram
) -> None:
    model = make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())
    motion = FingertipMotion(
        FingertipMotionConfig(),
        ArmPose(model, np.zeros((6, 6)), np.zeros(7)),
        fingertip_layout(),
    )
    own = [system for system in control.GetSystems() if system.get_name() != "twist_sum"]
    for system in [*own, *line_control.GetSystems(), motion]:
        for kind, names in declared(system).items():
            assert set(documented_ports(type(system).__doc__, kind)) == names, system.get_name()
    for make, diagram in ((make_flip_control, control), (make_line_control, line_control)):
        for kind, names in declared(diagram).items():
            assert set(documented_ports(make.__doc__, kind)) == names


def test_it_does_without_what_vision_says(control: Diagram) -> None:
    context = control.CreateDefaultContext()
    control.GetInputPort("taxel_measured").FixValue(context, np.zeros(12))
    state = np.concatenate([Q, np.zeros(7)])
    control.GetInputPort("joint_state_measured").FixValue(context, state)
    assert control.GetOutputPort("phase").Eval(context)[0] == 0.0
    command = control.GetOutputPort("joint_position_commanded").Eval(context)
    np.testing.assert_allclose(command, Q)


def test_the_arm_with_the_tool_stays_while_nothing_is_believed_of_it(line_control: Diagram) -> None:
    context = line_control.CreateDefaultContext()
    line_control.GetInputPort("flip_phase").FixValue(context, [0.0])
    state = np.concatenate([Q, np.zeros(7)])
    line_control.GetInputPort("joint_state_measured").FixValue(context, state)
    simulator = Simulator(line_control, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.1)
    command = line_control.GetOutputPort("joint_position_commanded").Eval(context)
    np.testing.assert_allclose(command, Q, atol=1e-9)
