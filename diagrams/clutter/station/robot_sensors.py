"""The sensors of both robots: joints, camera and taxels."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.geometry import Role
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import OutputPort

from crossmodal.diagrams.clutter.robot_config import (
    CAMERA_ARM,
    GRIPPER,
    LOOKER,
    TOUCH_ARM,
    TOUCHER,
)
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.add_arm import add_encoders
from crossmodal.diagrams.stations.add_cameras import CameraCarrier, add_cameras
from crossmodal.diagrams.stations.naming import own_seed
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import ARRAYS, gripper_taxels
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.sensors.taxel_array import TaxelArrayForces, TaxelArraySensor


@dataclass(frozen=True, kw_only=True)
class RobotSensors:
    """What is measured.

    Attributes:
        encoders: By the arms' models.
        taxels: `taxel_measured`.
        depth: `depth_measured`.
    """

    encoders: Mapping[str, JointEncoders]
    taxels: OutputPort
    depth: OutputPort


def arm_pose(calibration: Calibration, name: str) -> ArmPose:
    """Where an arm's end-effector is by its joints, as the robot knows it."""
    arm = calibration.arms[name]
    return ArmPose(arm.model, arm.covariance, arm.joint_offset_std)


def add_sensors(
    wiring: StationWiring, arms: Mapping[str, MultibodyPlant], homes: Mapping[str, Array]
) -> RobotSensors:
    """Adds encoders, the camera and the taxels; exports their windows and images.

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
    add_cameras(wiring, config.camera, colour_is_read=False, carriers={camera: carrier})
    layout = gripper_taxels()
    instance = wiring.scene.model(GRIPPER)
    inspector = wiring.scene.scene_graph.model_inspector()
    shapes = {
        inspector.GetName(shape).split("::")[-1]: shape
        for body in plant.GetBodyIndices(instance)
        for shape in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body), Role.kProximity)
    }
    forces = builder.AddNamedSystem(
        "taxel_forces",
        TaxelArrayForces(
            plant,
            plant.GetFrameByName("end_effector", instance),
            [shapes[name] for name in layout.names],
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
    stamps = builder.GetSubsystemByName("image_stamps")
    return RobotSensors(
        encoders=encoders,
        taxels=sensor.GetOutputPort("taxel_measured"),
        depth=stamps.GetOutputPort("depth_measured"),
    )
