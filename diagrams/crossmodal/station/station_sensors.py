"""The sensors of a station and their wires: what the body feels and what the eye sees."""

from pydrake.systems.primitives import MatrixGain

from controllers.interaction.grasp_sequence import GraspSequence
from diagrams.crossmodal.robot_config import ARM, HAND
from diagrams.crossmodal.station.wiring import StationWiring
from diagrams.run.calibration import Camera
from diagrams.stations.add_arm import add_encoders, add_wrist_wrench
from diagrams.stations.add_rgbd_camera import add_renderers, add_rgbd_camera, add_robot_mask
from diagrams.stations.lighting import Light
from maths.arrays import Array
from plants.hands.pneumatic_hand import PneumaticHand
from plants.hands.soft_hand import CLOSED_POSTURE, finger_selection
from plants.robots.arm_with_hand import add_robot
from plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from systems.sensors.air_pressure import PressureSensor
from systems.sensors.joint_encoders import JointEncoders
from systems.sensors.robot_mask import MaskedRobot


def add_proprioception(wiring: StationWiring, q_grasp: Array) -> JointEncoders:
    """Adds encoders, wrist sensor and the hand's pneumatics.

    Args:
        wiring: Of the station.
        q_grasp: True posture (n,) at the grasp, [rad].
    """
    builder, scene, sensors = wiring.builder, wiring.scene, wiring.scenario.sensors
    plant, seed = scene.plant, wiring.scenario.seed
    encoders = add_encoders(
        builder, plant, scene.model(ARM), wiring.true_arm, q_grasp, sensors.encoders, seed
    )
    sensor = plant.GetFrameByName("sensor", scene.model(HAND))
    add_wrist_wrench(builder, plant, sensor, sensors.wrench, seed)
    _add_pneumatics(wiring)
    return encoders


def _add_pneumatics(wiring: StationWiring) -> None:
    builder, plant, hand = wiring.builder, wiring.scene.plant, wiring.scene.model(HAND)
    pneumatics = builder.AddNamedSystem(
        "pneumatics", PneumaticHand(wiring.scenario.model_drivers[HAND].pneumatics)
    )
    fingers = builder.AddNamedSystem("finger_state", MatrixGain(finger_selection(plant, hand)))
    pressure = builder.AddNamedSystem(
        "pressure", PressureSensor(wiring.scenario.sensors.pressure, wiring.scenario.seed)
    )
    builder.Connect(plant.get_state_output_port(hand), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), pneumatics.GetInputPort("hand_state"))
    builder.Connect(pneumatics.GetOutputPort("joint_torques"), plant.get_actuation_input_port(hand))
    builder.Connect(pneumatics.GetOutputPort("cheat_pressure"), pressure.get_input_port())
    builder.ExportOutput(pressure.GetOutputPort("pressure_window"), "pressure_window")


def add_vision(
    wiring: StationWiring,
    encoders: JointEncoders,
    sequence: GraspSequence,
    camera: Camera,
    believed_camera: Camera,
    light: Light,
) -> None:
    """Adds the camera and the mask of the robot in its images.

    Args:
        wiring: Of the station.
        encoders: Of the arm.
        sequence: Which says how far the hand is closed.
        camera: As it is.
        believed_camera: As the robot knows it.
        light: Disturbances.
    """
    builder, scene, sensors = wiring.builder, wiring.scene, wiring.scenario.sensors
    add_renderers(scene.scene_graph, light.lamp)
    add_rgbd_camera(
        builder,
        scene.plant,
        scene.scene_graph,
        camera,
        sensors.camera,
        light,
        wiring.scenario.seed,
        wiring.scenario.network_period,
    )
    postures = {joint: (0.0, closed) for joint, closed in CLOSED_POSTURE.items()}
    robot = MaskedRobot(arm=ARM, arm_joints=ARM_JOINTS, hand=HAND, hand_posture=postures)
    mask = add_robot_mask(
        builder,
        lambda plant: add_robot(plant, WAM_WITH_SOFT_HAND, wiring.X_WBase, ARM, HAND),
        believed_camera,
        {"robot": robot},
        sensors.robot_mask,
    )
    for source, port in ((encoders, "joint_state_measured"), (sequence, "closure_commanded")):
        builder.Connect(source.GetOutputPort(port), mask.GetInputPort(port))
