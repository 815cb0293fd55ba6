"""The controllers that move the arm with the tool, and their wires."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.tool_line import ToolLine
from crossmodal.controllers.servoing.twist_to_joints import TwistToJoints
from crossmodal.diagrams.flap.flip_control import FlipControlConfig, joint_limits
from crossmodal.maths.arrays import Array


def make_line_control(
    config: FlipControlConfig, model: MultibodyPlant, q_initial: Array
) -> Diagram:
    """The tool's tip along a line, from what is measured and believed to joint positions.

    .. pydrake_system::

        name: line_control
        input_ports:
        - joint_state_measured
        - tool_latest
        - flip_phase
        output_ports:
        - joint_position_commanded
        - phase
        - failure
        - tip_estimated

    The belief may stay unconnected; then the arm stays where it is.

    Args:
        config: Of the parts.
        model: The arm's own model.
        q_initial: Posture in which the arm begins (n,), [rad].
    """
    builder, arm = DiagramBuilder(), ArmModel(model)
    line = builder.AddNamedSystem("tool_line", ToolLine(config.line, arm))
    joints = builder.AddNamedSystem(
        "twist_to_joints",
        TwistToJoints(config.holder_joints, arm, joint_limits(model), q_initial),
    )
    builder.Connect(line.GetOutputPort("twist_desired"), joints.GetInputPort("twist_desired"))
    measured = builder.ExportInput(
        line.GetInputPort("joint_state_measured"), "joint_state_measured"
    )
    builder.ConnectInput(measured, joints.GetInputPort("joint_state_measured"))
    for name in ("tool_latest", "flip_phase"):
        builder.ExportInput(line.GetInputPort(name), name)
    builder.ExportOutput(
        joints.GetOutputPort("joint_position_commanded"), "joint_position_commanded"
    )
    for name in ("phase", "failure", "tip_estimated"):
        builder.ExportOutput(line.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("line_control")
    return diagram
