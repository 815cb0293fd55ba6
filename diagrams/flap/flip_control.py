"""The controllers of both arms, which flip a flap and move its tool, and their connections."""

from dataclasses import dataclass, field

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.flip_config import FlipSequenceConfig
from crossmodal.controllers.servoing.flip_sequence import FlipSequence
from crossmodal.controllers.servoing.tactile_servoing import TactileServoing, TactileServoingConfig
from crossmodal.controllers.servoing.tool_line import ToolLine
from crossmodal.controllers.servoing.tool_line_decisions import ToolLineConfig
from crossmodal.controllers.servoing.twist_to_joints import (
    TwistToJoints,
    TwistToJointsConfig,
)
from crossmodal.controllers.servoing.visual_servoing import VisualServoing, VisualServoingConfig
from crossmodal.diagrams.stations.connections import connect_alike, export_input, export_outputs
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.shared_settings import with_shared
from crossmodal.systems.tactile.contact_features import ContactFeaturesConfig
from crossmodal.systems.tactile.taxel_layout import TaxelLayout
from crossmodal.systems.tactile.taxel_monitor import TaxelMonitor


@dataclass(kw_only=True)
class FlipControlConfig:
    # With which the finger presses on the flap's edge.
    force: float = number(0.5, above=0.0, at_most=100.0, unit="N")
    features: ContactFeaturesConfig = field(default_factory=ContactFeaturesConfig)
    sequence: FlipSequenceConfig = field(default_factory=FlipSequenceConfig)
    tactile: TactileServoingConfig = field(default_factory=TactileServoingConfig)
    visual: VisualServoingConfig = field(default_factory=VisualServoingConfig)
    joints: TwistToJointsConfig = field(default_factory=TwistToJointsConfig)
    # What the arm that holds the tool does with it then.
    line: ToolLineConfig = field(default_factory=ToolLineConfig)
    holder_joints: TwistToJointsConfig = field(default_factory=TwistToJointsConfig)


def make_flip_control(
    config: FlipControlConfig,
    model: MultibodyPlant,
    layout: TaxelLayout,
    q_initial: Array,
) -> Diagram:
    """Touch, vision and sequence together, from what is measured to joint positions.

    Input ports:
    - `taxel_measured`, `joint_state_measured`: of the finger.
    - `flap_angle_latest`, `hinge_latest`, `flap_plane_latest`: beliefs, which may stay unconnected.
    - `force_desired`, `feed_speed`: of `FlipSequence`; may stay unconnected.

    Output ports:
    - `joint_position_commanded`: (n,) of the finger's arm, [rad].
    - `contact_latest`, `taxel_health_latest`: of `TaxelMonitor`.
    - `phase`, `failure`: of `FlipSequence`.

    Args:
        model: The arm's own model.
        q_initial: Posture in which the arm begins (n,), [rad].
    """
    config = with_shared(config, force=config.force)
    builder, arm = DiagramBuilder(), ArmModel(model)
    add = builder.AddNamedSystem
    taxels = add("taxel_monitor", TaxelMonitor(config.features, layout))
    sequence = add("flip_sequence", FlipSequence(config.sequence, arm))
    tactile = add("tactile_servoing", TactileServoing(config.tactile, layout.semi_axes))
    visual = add(
        "visual_servoing", VisualServoing(config.visual, arm, reach=float(layout.semi_axes[1]))
    )
    total = add("twist_sum", Adder(3, 6))
    joints = add("twist_to_joints", TwistToJoints(config.joints, arm, q_initial))
    # At one instant the monitor stores before the controllers step, so that this is the contact of
    # now, computed once.
    connect_alike(builder, taxels, "contact_latest", sequence, tactile, visual)
    connect_alike(builder, sequence, "tactile_projector", tactile)
    connect_alike(builder, sequence, "visual_projector", visual)
    connect_alike(builder, sequence, "feed_forward", visual)
    connect_alike(builder, tactile, "tactile_twist_desired", visual)
    connect_alike(builder, joints, "twist_share", tactile)
    connect_alike(builder, visual, "misalignment_seen", sequence)
    health = taxels.GetOutputPort("health_latest")
    builder.Connect(health, sequence.GetInputPort("taxel_health_latest"))
    twists = (
        sequence.GetOutputPort("approach_twist_desired"),
        tactile.GetOutputPort("tactile_twist_desired"),
        visual.GetOutputPort("visual_twist_desired"),
    )
    for index, twist in enumerate(twists):
        builder.Connect(twist, total.get_input_port(index))
    builder.Connect(total.get_output_port(), joints.GetInputPort("twist_desired"))
    export_input(builder, "joint_state_measured", sequence, visual, joints)
    export_input(builder, "flap_angle_latest", sequence, visual)
    export_input(builder, "hinge_latest", sequence, visual)
    export_input(builder, "flap_plane_latest", visual)
    export_input(builder, "taxel_measured", taxels)
    export_input(builder, "force_desired", sequence, tactile)
    export_input(builder, "feed_speed", sequence)
    export_outputs(builder, joints, "joint_position_commanded")
    export_outputs(builder, sequence, "phase", "failure")
    export_outputs(builder, taxels, "contact_latest")
    builder.ExportOutput(health, "taxel_health_latest")
    diagram = builder.Build()
    diagram.set_name("flip_control")
    return diagram


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
        model: The arm's own model.
        q_initial: Posture in which the arm begins (n,), [rad].
    """
    builder, arm = DiagramBuilder(), ArmModel(model)
    line = builder.AddNamedSystem("tool_line", ToolLine(config.line, arm))
    joints = builder.AddNamedSystem(
        "twist_to_joints", TwistToJoints(config.holder_joints, arm, q_initial)
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
