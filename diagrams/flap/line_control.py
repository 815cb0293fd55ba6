"""The controllers that move the arm with the tool, and their wires."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.tool_line import ToolLine
from crossmodal.controllers.servoing.twist_to_joints import TwistToJoints
from crossmodal.diagrams.flap.flip_control import FlipControlConfig, joint_limits
from crossmodal.diagrams.stations.connections import connect_alike, export_input, export_outputs
from crossmodal.maths.arrays import Array


def make_line_control(
    config: FlipControlConfig, model: MultibodyPlant, q_initial: Array
) -> Diagram:
    """The tool's tip along a line, from what is measured and believed to joint positions.

    Input ports:
    - `joint_state_measured`: of the holder.
    - `tool_latest`: the belief; unconnected, the arm stays where it is.
    - `flip_phase`: of `FlipSequence`.

    Output ports:
    - `joint_position_commanded`: (n,) of the holder's arm, [rad].
    - `phase`, `failure`, `tip_estimated`: of `ToolLine`.

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
    connect_alike(builder, line, "twist_desired", joints)
    export_input(builder, "joint_state_measured", line, joints)
    export_input(builder, "tool_latest", line)
    export_input(builder, "flip_phase", line)
    export_outputs(builder, joints, "joint_position_commanded")
    export_outputs(builder, line, "phase", "failure", "tip_estimated")
    diagram = builder.Build()
    diagram.set_name("line_control")
    return diagram
