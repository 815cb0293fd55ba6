"""The controllers of a station and their wires."""

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.primitives import ZeroOrderHold

from controllers.arm.kinematics import ArmModel
from controllers.arm.motion_switch import MotionSwitch
from controllers.interaction.bending_excitation import BendingExcitation
from controllers.interaction.exploration import ExplorationController
from controllers.interaction.grasp_sequence import GraspSequence
from controllers.interaction.joint_memory import JointMemory
from controllers.interaction.pull_direction import PullDirection
from controllers.interaction.trajectory_generator import TrajectoryGenerator
from diagrams.crossmodal.station.station_config import ARM, StationWiring
from diagrams.stations.add_arm import add_impedance_control
from maths import se3
from maths.arrays import Array
from plants.robots.inverse_kinematics import inverse_kinematics
from plants.scene import facing
from systems.sensors.joint_encoders import JointEncoders

# What commands the arm, each in place of those before it.
MOTION_SOURCES = ("sequence", "exploration", "return")
# What control is told of the perceived joint; see `InteractedJoint`.
PERCEIVED_INPUTS = ("joint_latest", "end_effector_screw_latest", "grasp_failure_latest")


def taught_postures(wiring: StationWiring, X_WHandle: RigidTransform) -> tuple[Array, Array]:
    """True arm postures (n,) at the grasp that a person guided the hand to, and before it."""
    control = wiring.config.control
    rng = np.random.default_rng((wiring.seed, 1))
    rotation = se3.so3_exp(rng.normal(0.0, control.guidance_rotation, 3))
    X_guided = RigidTransform(
        RotationMatrix(rotation), rng.normal(0.0, control.guidance_translation, 3)
    )
    X_WE = facing(X_WHandle) @ X_guided
    back = RigidTransform([0.0, 0.0, -control.sequence.approach_distance])
    q_grasp = inverse_kinematics(wiring.true_arm, X_WE, control.posture)
    return q_grasp, inverse_kinematics(wiring.true_arm, X_WE @ back, q_grasp)


def add_control(
    wiring: StationWiring,
    encoders: JointEncoders,
    q_taught: Array,
    q_before: Array,
    direction_E: Array,
) -> GraspSequence:
    builder, plant, control = wiring.builder, wiring.scene.plant, wiring.config.control
    arm = ArmModel(wiring.arm)
    X_WE, X_WE_before = (
        arm.Evaluate(np.concatenate([q, np.zeros(arm.num_joints)])).X_WE
        for q in (q_taught, q_before)
    )
    sequence = builder.AddNamedSystem(
        "grasp_sequence",
        GraspSequence(control.sequence, arm, X_WE, X_WE_before, wiring.config.goal),
    )
    pull = builder.AddNamedSystem(
        "pull_direction", PullDirection(control.pull_direction, arm, direction_E)
    )
    switch = builder.AddNamedSystem("motion_switch", MotionSwitch(MOTION_SOURCES))
    if control.excitation is None:
        exploration = builder.AddNamedSystem(
            "exploration", ExplorationController(control.exploration, arm)
        )
        builder.Connect(pull.get_output_port(), exploration.GetInputPort("pull_direction"))
        builder.Connect(
            encoders.GetOutputPort("joint_state_measured"),
            exploration.GetInputPort("joint_state_measured"),
        )
        builder.Connect(
            switch.GetOutputPort("motion_commanded"), exploration.GetInputPort("motion_commanded")
        )
        # All sources then change at the same instants, and each goes on from the last one's motion.
        motion = builder.AddNamedSystem(
            "sequence_motion", ZeroOrderHold(control.sequence.period, Value[object]())
        )
        builder.Connect(sequence.GetOutputPort("motion_desired"), motion.get_input_port())
        grasp_motion = motion.get_output_port()
    else:
        start = control.sequence.approach_time + control.sequence.close_time
        exploration = builder.AddNamedSystem(
            "excitation", BendingExcitation(control.excitation, start, wiring.seed)
        )
        grasp_motion = sequence.GetOutputPort("motion_desired")
        builder.Connect(grasp_motion, exploration.GetInputPort("grasp_motion_desired"))
    builder.Connect(grasp_motion, switch.GetInputPort("sequence_motion_desired"))
    impedance = add_impedance_control(
        builder, plant, wiring.scene.model(ARM), encoders, arm, control.impedance, q_taught
    )
    pneumatics = builder.GetSubsystemByName("pneumatics")
    builder.Connect(
        builder.GetSubsystemByName("pressure").GetOutputPort("pressure_measured"),
        sequence.GetInputPort("pressure_measured"),
    )
    memory = builder.AddNamedSystem("joint_memory", JointMemory(control.sequence.period))
    generator = builder.AddNamedSystem(
        "trajectory_generator", TrajectoryGenerator(control.trajectory, arm)
    )
    for system in (sequence, pull, generator):
        builder.Connect(
            encoders.GetOutputPort("joint_state_measured"),
            system.GetInputPort("joint_state_measured"),
        )
    for source, output, target, port in (
        (sequence, "gains_desired", switch, "sequence_gains_desired"),
        (exploration, "motion_desired", switch, "exploration_motion_desired"),
        (generator, "motion_desired", switch, "return_motion_desired"),
        (generator, "gains_desired", switch, "return_gains_desired"),
        (switch, "motion_commanded", impedance, "motion_desired"),
        (switch, "gains_commanded", impedance, "gains_desired"),
        (sequence, "phase", exploration, "phase"),
        (sequence, "phase", memory, "phase"),
        (sequence, "phase", pull, "phase"),
        (pull, "pull_direction", sequence, "pull_direction"),
        (sequence, "phase", generator, "phase"),
        (sequence, "in_free_space", impedance, "tare"),
        (generator, "plan_time_left", sequence, "plan_time_left"),
        *(
            (memory, port, target, port)
            for port in ("joint_remembered", "end_effector_screw_remembered")
            for target in (sequence, pull, generator)
        ),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(port))
    for port in PERCEIVED_INPUTS:
        source = builder.ExportInput(
            (sequence if sequence.HasInputPort(port) else memory).GetInputPort(port), port
        )
        if generator.HasInputPort(port):
            builder.ConnectInput(source, generator.GetInputPort(port))
    builder.ExportOutput(generator.GetOutputPort("path_planned"), "path_planned")
    for port in ("pressure_commanded", "sealed"):
        builder.Connect(sequence.GetOutputPort(port), pneumatics.GetInputPort(port))
    for port in ("interaction_active", "phase", "grasp_lost"):
        builder.ExportOutput(sequence.GetOutputPort(port), port)
    return sequence
