"""An arm of a station: its sensors and its controller."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from crossmodal.controllers.arm.impedance import ImpedanceConfig, ImpedanceController
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.diagrams.stations.connections import connect_alike
from crossmodal.diagrams.stations.naming import own_seed, prefixed
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.maths.arrays import Array
from crossmodal.systems.sensors.joint_encoders import JointEncoders, JointEncodersConfig
from crossmodal.systems.sensors.wrist_wrench import (
    ReactionWrench,
    WristWrenchConfig,
    WristWrenchSensor,
)


def add_encoders(
    wiring: StationWiring,
    arm: str,
    true_arm: MultibodyPlant,
    q_nominal: Array,
    config: JointEncodersConfig,
    owner: str = "",
) -> JointEncoders:
    """Adds the encoders of an arm's joints; exports `joint_state_window`.

    Args:
        arm: Name of the arm's model in the scene.
        true_arm: The arm alone, as it is.
        q_nominal: Posture (n,) at which the end-effector's offset has its covariance, [rad].
        owner: Name of the arm where there are several; it then begins the names.
    """
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    context = true_arm.CreateDefaultContext()
    true_arm.SetPositions(context, q_nominal)
    frame = true_arm.GetFrameByName("end_effector")
    J_E = true_arm.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), true_arm.world_frame(), frame
    )
    seed, tick = own_seed(scenario.seed, owner), scenario.network_period
    encoders = builder.AddNamedSystem(
        prefixed(owner, "encoders"), JointEncoders(config, J_E, seed, tick)
    )
    state = plant.get_state_output_port(wiring.scene.model(arm))
    builder.Connect(state, encoders.GetInputPort("joint_state"))
    window = encoders.GetOutputPort("joint_state_window")
    builder.ExportOutput(window, prefixed(owner, "joint_state_window"))
    return encoders


def add_wrist_wrench(
    wiring: StationWiring, sensor: Frame, config: WristWrenchConfig, owner: str = ""
) -> WristWrenchSensor:
    """Adds the sensor of what a hand does to the arm that carries it; exports `wrench_window`.

    Args:
        sensor: S, a frame of the first body beyond the joint or weld that the sensor measures.
        owner: Name of the arm where there are several; it then begins the names.
    """
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    (mount,) = (
        joint
        for joint in map(plant.get_joint, plant.GetJointIndices())
        if joint.child_body().index() == sensor.body().index()
    )
    X_JcS = sensor.CalcPose(plant.CreateDefaultContext(), mount.frame_on_child())
    load = builder.AddNamedSystem(
        prefixed(owner, "wrist_load"), ReactionWrench(plant, mount, X_JcS)
    )
    seed, tick = own_seed(scenario.seed, owner), scenario.network_period
    wrench = builder.AddNamedSystem(
        prefixed(owner, "wrench"), WristWrenchSensor(config, seed, tick)
    )
    builder.Connect(plant.get_reaction_forces_output_port(), load.get_input_port())
    builder.Connect(load.get_output_port(), wrench.get_input_port())
    builder.ExportOutput(wrench.GetOutputPort("wrench_window"), prefixed(owner, "wrench_window"))
    return wrench


def add_impedance_control(
    wiring: StationWiring,
    arm: str,
    encoders: JointEncoders,
    model: ArmModel,
    config: ImpedanceConfig,
    q_posture: Array,
    owner: str = "",
) -> ImpedanceController:
    """Adds the controller that moves an arm; motion, gains and tare are left to be connected.

    Args:
        arm: Name of the arm's model in the scene.
        model: What the robot believes of the arm.
        q_posture: What the null space's spring draws the joints to (n,), [rad].
        owner: Name of the arm where there are several; it then begins the system's name.
    """
    builder, port = wiring.builder, wiring.plant.get_actuation_input_port(wiring.scene.model(arm))
    impedance = builder.AddNamedSystem(
        prefixed(owner, "impedance"), ImpedanceController(config, model, q_posture)
    )
    connect_alike(builder, encoders, "joint_state_measured", impedance)
    builder.Connect(impedance.get_output_port(), port)
    return impedance
