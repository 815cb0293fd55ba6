"""The sensors of a station and their connections: of touch and of vision."""

from crossmodal.controllers.interaction.grasp_sequence import GraspSequence
from crossmodal.diagrams.crossmodal.modalities import sees
from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.crossmodal.station.wiring import StationWiring
from crossmodal.diagrams.stations.add_arm import add_encoders, add_wrist_wrench
from crossmodal.diagrams.stations.add_cameras import add_cameras, add_robot_masks
from crossmodal.diagrams.stations.add_soft_hand import add_soft_hand
from crossmodal.maths.arrays import Array
from crossmodal.plants.hands.soft_hand import CLOSED_POSTURE
from crossmodal.plants.robots.arm_with_hand import add_robot
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.sensors.robot_mask import MaskedRobot


def add_proprioception(wiring: StationWiring, q_grasp: Array) -> JointEncoders:
    """Adds encoders, wrist sensor and the hand's pneumatics.

    Args:
        q_grasp: True posture (n,) at the grasp, [rad].
    """
    scenario, sensors = wiring.scenario, wiring.scenario.sensors
    encoders = add_encoders(wiring, ARM, wiring.true_arm, q_grasp, sensors.encoders)
    sensor = wiring.plant.GetFrameByName("sensor", wiring.scene.model(HAND))
    add_wrist_wrench(wiring, sensor, sensors.wrench)
    add_soft_hand(
        wiring,
        HAND,
        scenario.model_drivers[HAND].pneumatics,
        sensors.pressure,
        leaks=scenario.disturbances.hand_leaks,
    )
    return encoders


def add_vision(wiring: StationWiring, encoders: JointEncoders, sequence: GraspSequence) -> None:
    """Adds the camera and the mask of the robot in its images.

    Args:
        sequence: Which says how far the hand is closed.
    """
    sensors = wiring.scenario.sensors
    add_cameras(wiring, sensors.camera, colour_is_streamed=sees(wiring.scenario))
    postures = {joint: (0.0, closed) for joint, closed in CLOSED_POSTURE.items()}
    robot = MaskedRobot(arm=ARM, arm_joints=ARM_JOINTS, hand=HAND, hand_posture=postures)
    add_robot_masks(
        wiring,
        lambda plant: add_robot(plant, WAM_WITH_SOFT_HAND, wiring.arm.X_WBase, ARM, HAND),
        {"robot": robot},
        sensors.robot_mask,
        {
            "joint_state_measured": encoders.GetOutputPort("joint_state_measured"),
            "closure_commanded": sequence.GetOutputPort("closure_commanded"),
        },
    )
