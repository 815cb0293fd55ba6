"""The sensors of both robots: joints, fingers, camera and taxels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import OutputPort
from pydrake.systems.primitives import MatrixGain

from crossmodal.diagrams.clutter.robot_config import (
    CAMERA_ARM,
    CAMERA_HAND,
    GRIPPER,
    LOOKER,
    ROBOTS,
    TOUCH_ARM,
    TOUCHER,
)
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.believed import arm_pose
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.sensor_streams.stream_faults import add_stream_faults, faults_of
from crossmodal.diagrams.stations.add_arm import add_encoders
from crossmodal.diagrams.stations.add_cameras import (
    CameraCarrier,
    add_cameras,
    add_robot_masks,
)
from crossmodal.diagrams.stations.naming import own_seed, prefixed
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import ARRAYS, gripper_taxels
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.plants.hands.taxel_gripper import JOINTS as GRIPPER_JOINTS
from crossmodal.plants.hands.taxel_gripper import finger_shapes
from crossmodal.plants.robots.arm_with_hand import add_robot
from crossmodal.plants.robots.panda import ARM_JOINTS as PANDA_JOINTS
from crossmodal.plants.robots.ur5 import ARM_JOINTS as UR5_JOINTS
from crossmodal.systems.registration.robot_view import ArmChain, RobotView
from crossmodal.systems.registration.seen_arm import ARM
from crossmodal.systems.sensors.finger_encoders import FingerEncoders
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.sensors.robot_mask import MaskedRobot
from crossmodal.systems.sensors.stream_fault import BY_HAND
from crossmodal.systems.sensors.taxel_array import TaxelArrayForces, TaxelArraySensor

NUMB = "taxels_silenced"  # Input of the station, (1,) above 0.5 while its taxels say nothing new.


@dataclass(frozen=True, kw_only=True)
class RobotSensors:
    """What is measured.

    Attributes:
        encoders: By the arms' models.
        taxels: `taxel_measured`.
        fingers: `hand_positions_measured` of the gripper.
        colour: `color_measured`.
        depth: `depth_measured`.
        mask: `robot_mask`, the pixels of both robots.
    """

    encoders: Mapping[str, JointEncoders]
    taxels: OutputPort
    fingers: OutputPort
    colour: OutputPort
    depth: OutputPort
    mask: OutputPort


def touch_arm_view(calibration: Calibration, X_WC: Array) -> RobotView:
    """Renders the touching arm where it believes to be, from a pose of the camera (4, 4)."""

    def build(plant: MultibodyPlant) -> None:
        X_WBase = calibration.arms[TOUCH_ARM].X_WBase
        add_robot(plant, ROBOTS[TOUCH_ARM], X_WBase, TOUCH_ARM, GRIPPER)

    return RobotView(
        build,
        renderer_intrinsics(calibration.camera.intrinsics),
        RigidTransform(X_WC),
        {ARM: ArmChain(TOUCH_ARM, UR5_JOINTS, GRIPPER)},
    )


def _add_believed_robots(plant: MultibodyPlant, calibration: Calibration) -> None:
    """Adds both robots where they believe to stand."""
    for arm, hand in ((CAMERA_ARM, CAMERA_HAND), (TOUCH_ARM, GRIPPER)):
        add_robot(plant, ROBOTS[arm], calibration.arms[arm].X_WBase, arm, hand)


def _add_finger_encoders(wiring: StationWiring) -> OutputPort:
    """Adds what measures the gripper's joints (2,), and returns `hand_positions_measured`."""
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    instance, fingers = wiring.scene.model(GRIPPER), len(GRIPPER_JOINTS)
    positions = builder.AddNamedSystem("finger_positions", MatrixGain(np.eye(fingers, 2 * fingers)))
    encoders = builder.AddNamedSystem(
        "finger_encoders",
        FingerEncoders(scenario.sensors.fingers, fingers, scenario.network_period),
    )
    builder.Connect(plant.get_state_output_port(instance), positions.get_input_port())
    builder.Connect(positions.get_output_port(), encoders.get_input_port())
    return encoders.GetOutputPort("hand_positions_measured")


def add_sensors(
    wiring: StationWiring, arms: Mapping[str, MultibodyPlant], homes: Mapping[str, Array]
) -> RobotSensors:
    """Adds encoders, the camera and the taxels; exports windows of arms and taxels, and images.

    The input `taxels_silenced` may stay unconnected.

    Args:
        arms: The arms alone, as they are, by their names.
        homes: Postures at which the encoders' errors are given (n,), by the arms' names, [rad].
    """
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    config = scenario.sensors
    encoders = {
        arm: add_encoders(wiring, arm, arms[arm], homes[arm], config.encoders, owner)
        for owner, arm in ((LOOKER, CAMERA_ARM), (TOUCHER, TOUCH_ARM))
    }
    (camera,) = wiring.calibration.cameras
    carrier = CameraCarrier(
        pose=arm_pose(wiring.calibration, CAMERA_ARM),
        joint_state=encoders[CAMERA_ARM].GetOutputPort("joint_state_measured"),
    )
    depths = add_cameras(
        wiring, config.camera, colour_is_streamed=False, carriers={camera: carrier}
    )
    postures = {
        prefixed(owner, "joint_state_measured"): encoders[arm].GetOutputPort("joint_state_measured")
        for owner, arm in ((LOOKER, CAMERA_ARM), (TOUCHER, TOUCH_ARM))
    }
    fingers = _add_finger_encoders(wiring)
    postures[prefixed(TOUCHER, "hand_positions_measured")] = fingers
    add_robot_masks(
        wiring,
        lambda plant: _add_believed_robots(plant, wiring.calibration),
        {
            LOOKER: MaskedRobot(arm=CAMERA_ARM, arm_joints=PANDA_JOINTS),
            TOUCHER: MaskedRobot(
                arm=TOUCH_ARM,
                arm_joints=UR5_JOINTS,
                hand=GRIPPER,
                hand_joints=GRIPPER_JOINTS,
            ),
        },
        config.robot_mask,
        postures,
        depths,
    )
    layout = gripper_taxels()
    instance = wiring.scene.model(GRIPPER)
    shapes = finger_shapes(plant, wiring.scene.scene_graph.model_inspector(), instance)
    forces = builder.AddNamedSystem(
        "taxel_forces",
        TaxelArrayForces(
            plant,
            plant.GetFrameByName("end_effector", instance),
            shapes.taxels,
            shapes.cores,
            layout,
        ),
    )
    builder.Connect(plant.get_contact_results_output_port(), forces.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), forces.GetInputPort("body_poses"))
    sensor = builder.AddNamedSystem(
        "taxels",
        TaxelArraySensor(
            config.taxels,
            ARRAYS,
            layout.array,
            own_seed(scenario.seed, GRIPPER),
            scenario.disturbances.taxels,
            scenario.network_period,
        ),
    )
    builder.Connect(forces.get_output_port(), sensor.get_input_port())
    builder.ExportOutput(sensor.GetOutputPort("taxel_window"), "taxel_window")
    taxels, period = "taxel_measured", config.taxels.period
    felt = add_stream_faults(builder, sensor, [], period, scenario.seed, by_hand=[taxels])(taxels)
    numb = builder.GetSubsystemByName(faults_of(taxels)).GetInputPort(BY_HAND)
    builder.ExportInput(numb, NUMB)
    stamps = builder.GetSubsystemByName("image_stamps")
    images = ("color_measured", "depth_measured")
    faults = [fault for fault in scenario.disturbances.faults if fault.stream in images]
    heard = add_stream_faults(builder, stamps, faults, scenario.network_period, scenario.seed)
    return RobotSensors(
        encoders=encoders,
        taxels=felt,
        fingers=fingers,
        colour=heard("color_measured"),
        depth=heard("depth_measured"),
        mask=builder.GetSubsystemByName("robot_mask").GetOutputPort("robot_mask"),
    )
