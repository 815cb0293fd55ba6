"""The controllers of a station and their connections."""

from collections.abc import Iterator

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import ZeroOrderHold

from crossmodal.controllers.arm.inverse_kinematics import inverse_kinematics
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_switch import MotionSwitch
from crossmodal.controllers.interaction.bending_excitation import BendingExcitation
from crossmodal.controllers.interaction.exploration import ExplorationController
from crossmodal.controllers.interaction.grasp_decisions import Goal
from crossmodal.controllers.interaction.grasp_sequence import GraspSequence
from crossmodal.controllers.interaction.joint_memory import JointMemory
from crossmodal.controllers.interaction.pull_direction import PullDirection
from crossmodal.controllers.interaction.trajectory_generator import TrajectoryGenerator
from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.crossmodal.station.wiring import StationWiring
from crossmodal.diagrams.stations.add_arm import add_impedance_control
from crossmodal.diagrams.stations.connections import (
    connect,
    connect_alike,
    export_input,
    export_outputs,
)
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.scene import facing
from crossmodal.systems.sensors.joint_encoders import JointEncoders

# What commands the arm, each in place of those before it.
MOTION_SOURCES = ("sequence", "exploration", "return")
# What reaches control of the perceived joint; see `HeldJoint`.
_IN_REACH = np.array([0.79, -0.25, 0.86])  # The drawer's handle, [m].
PULL_SPEED = "pull_speed"  # Input of the station, (1,) [m/s].
PERCEIVED_INPUTS = ("joint_latest", "end_effector_screw_latest", "grasp_failure_latest")


def taught_postures(
    wiring: StationWiring, X_WHandle: RigidTransform, X_HandleO: RigidTransform
) -> tuple[Array, Array]:
    """True arm postures (n,) at the grasp that a person guided the hand to, and before it.

    Args:
        X_WHandle: Pose of the handle.
        X_HandleO: Pose of the object's model in it, to say where the object would be in reach.

    Raises:
        ValueError: in one line, for a handle that the arm does not reach.
    """
    control = wiring.scenario.control
    rng = np.random.default_rng((wiring.scenario.seed, 1))
    rotation = se3.so3_exp(rng.normal(0.0, control.guidance_rotation, 3))
    X_guided = RigidTransform(
        RotationMatrix(rotation), rng.normal(0.0, control.guidance_translation, 3)
    )
    back = RigidTransform([0.0, 0.0, -control.sequence.approach_distance])

    def postures(X_WH: RigidTransform) -> tuple[Array, Array]:
        X_WE = facing(X_WH) @ X_guided
        q_grasp = inverse_kinematics(wiring.true_arm, X_WE, control.posture)
        return q_grasp, inverse_kinematics(wiring.true_arm, X_WE @ back, q_grasp)

    try:
        return postures(X_WHandle)
    except ValueError as error:
        reason = f"{error}; place the object elsewhere"
    for X_WO in _nearer_poses(X_WHandle, X_HandleO):
        try:
            postures(X_WO @ X_HandleO.inverse())
        except ValueError:
            continue
        given = [*X_WO.translation(), *RollPitchYaw(X_WO.rotation()).vector()]
        listed = ",".join(f"{round(value, 2) + 0.0:g}" for value in given)
        raise ValueError(f"{reason}: its frame at --object-pose {listed} (objects.NAME.position)")
    raise ValueError(f"{reason} (objects.NAME.position)")


def _nearer_poses(X_WHandle: RigidTransform, X_HandleO: RigidTransform) -> Iterator[RigidTransform]:
    """Poses X_WO from the object's own to one whose handle the arm reaches easily, rounded."""
    for R_WH in (X_WHandle.rotation(), RotationMatrix.MakeZRotation(np.pi)):
        for share in (0.2, 0.4, 0.6, 0.8, 1.0):
            p_WH = X_WHandle.translation() + share * (_IN_REACH - X_WHandle.translation())
            X_WO = RigidTransform(R_WH, p_WH) @ X_HandleO
            angles = RollPitchYaw(X_WO.rotation()).vector().round(2)
            yield RigidTransform(RollPitchYaw(angles), X_WO.translation().round(2))


def add_control(
    wiring: StationWiring,
    encoders: JointEncoders,
    q_taught: Array,
    q_before: Array,
    direction_E: Array,
) -> GraspSequence:
    """Adds the controllers, from what is perceived to arm and hand.

    Args:
        q_taught: Posture (n,) of the grasp as the encoders read it, [rad].
        q_before: Likewise where the approach begins.
        direction_E: Taught direction of the pull (3,), in E.
    """
    builder, control = wiring.builder, wiring.scenario.control
    arm = ArmModel(wiring.arm.model)
    still = np.zeros(arm.num_joints)
    X_WE, X_WE_before = (
        arm.Evaluate(np.concatenate([q, still])).X_WE for q in (q_taught, q_before)
    )
    task = wiring.scenario.task
    goal = Goal(configuration=task.goal, return_to_start=task.return_to_start)
    sequence = builder.AddNamedSystem(
        "grasp_sequence",
        GraspSequence(control.sequence, arm, X_WE, X_WE_before, goal),
    )
    memory = builder.AddNamedSystem("joint_memory", JointMemory(control.sequence.period))
    pull = builder.AddNamedSystem(
        "pull_direction", PullDirection(control.pull_direction, arm, direction_E)
    )
    generator = builder.AddNamedSystem(
        "trajectory_generator", TrajectoryGenerator(control.trajectory, arm)
    )
    impedance = add_impedance_control(wiring, ARM, encoders, arm, control.impedance, q_taught)
    switch = builder.AddNamedSystem("motion_switch", MotionSwitch(MOTION_SOURCES))
    if control.excitation is None:
        exploration = ExplorationController(control.exploration, arm)
        _add_exploration(builder, exploration, sequence, pull, switch, control.sequence.period)
        measuring: tuple[System, ...] = (sequence, pull, generator, exploration)
    else:
        start = control.sequence.approach_time + control.sequence.close_time
        excitation = BendingExcitation(control.excitation, start, wiring.scenario.seed)
        _add_excitation(builder, excitation, sequence, switch)
        measuring = (sequence, pull, generator)
    connect_alike(builder, encoders, "joint_state_measured", *measuring)
    pneumatics, pressure = map(builder.GetSubsystemByName, ("pneumatics", "pressure"))
    connect(
        builder,
        (
            (sequence, "gains_desired", switch, "sequence_gains_desired"),
            (generator, "motion_desired", switch, "return_motion_desired"),
            (generator, "gains_desired", switch, "return_gains_desired"),
            (switch, "motion_commanded", impedance, "motion_desired"),
            (switch, "motion_commanded", sequence, "motion_commanded"),
            (switch, "gains_commanded", impedance, "gains_desired"),
            (sequence, "in_free_space", impedance, "tare"),
            (pull, "pull_direction", sequence, "pull_direction"),
            (generator, "plan_time_left", sequence, "plan_time_left"),
            (pressure, "pressure_measured", sequence, "pressure_measured"),
            *((sequence, port, pneumatics, port) for port in ("pressure_commanded", "sealed")),
            *((sequence, "phase", target, "phase") for target in (memory, pull, generator)),
            *(
                (memory, port, target, port)
                for port in ("joint_remembered", "end_effector_screw_remembered")
                for target in (sequence, pull, generator)
            ),
        ),
    )
    for name in PERCEIVED_INPUTS:  # Each perceived quantity goes to all that read it.
        parts = (part for part in (sequence, memory, generator) if part.HasInputPort(name))
        export_input(builder, name, *parts)
    export_outputs(builder, generator, "path_planned")
    export_outputs(builder, sequence, "interaction_active", "phase", "grasp_lost", "stuck")
    return sequence


def _add_exploration(
    builder: DiagramBuilder,
    exploration: ExplorationController,
    sequence: GraspSequence,
    pull: PullDirection,
    switch: MotionSwitch,
    period: float,
) -> None:
    """The sequence's motion is held between its updates, as the other sources hold theirs."""
    builder.AddNamedSystem("exploration", exploration)
    builder.ExportInput(exploration.GetInputPort("speed"), PULL_SPEED)
    motion = sequence.GetOutputPort("motion_desired")
    held = builder.AddNamedSystem("sequence_motion", ZeroOrderHold(period, motion.Allocate()))
    builder.Connect(motion, held.get_input_port())
    builder.Connect(held.get_output_port(), switch.GetInputPort("sequence_motion_desired"))
    connect(
        builder,
        (
            (pull, "pull_direction", exploration, "pull_direction"),
            (sequence, "phase", exploration, "phase"),
            (switch, "motion_commanded", exploration, "motion_commanded"),
            (exploration, "motion_desired", switch, "exploration_motion_desired"),
        ),
    )


def _add_excitation(
    builder: DiagramBuilder,
    excitation: BendingExcitation,
    sequence: GraspSequence,
    switch: MotionSwitch,
) -> None:
    builder.AddNamedSystem("excitation", excitation)
    connect(
        builder,
        (
            (sequence, "phase", excitation, "phase"),
            (sequence, "motion_desired", excitation, "grasp_motion_desired"),
            (sequence, "motion_desired", switch, "sequence_motion_desired"),
            (excitation, "motion_desired", switch, "exploration_motion_desired"),
        ),
    )
