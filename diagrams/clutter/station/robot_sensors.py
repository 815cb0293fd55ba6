"""The sensors of both robots, and what is measured with them of the object."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from crossmodal.models.gripper_taxels import ARRAYS, RADIUS, gripper_taxels
from pydrake.geometry import Role
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import OutputPort, System

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.diagrams.clutter.robot_config import (
    CAMERA_ARM,
    GRIPPER,
    LOOKER,
    TOUCH_ARM,
    TOUCHER,
)
from crossmodal.diagrams.clutter.station.robot_control import RobotControl
from crossmodal.diagrams.stations.add_arm import add_encoders
from crossmodal.diagrams.stations.add_cameras import add_cameras
from crossmodal.diagrams.stations.naming import own_seed
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.maths.arrays import Array
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.pose_measurements import (
    CameraOnArm,
    PoseMeasurements,
    TaxelsOnArm,
)
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.sensors.randomness import make_generator
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
    add_cameras(wiring, config.camera, colour_is_read=False)
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


def add_measurements(
    wiring: StationWiring,
    model: TargetModel,
    table: Table | None,
    sensors: RobotSensors,
    guess: OutputPort,
    control: RobotControl,
) -> System:
    """Adds what makes measurements of the object's pose of what the sensors give.

    Args:
        model: Of the object.
        table: As believed.
        sensors: Of the robots.
        guess: `pose_guess`.
        control: What moves the arms, and knows when they are where they should be.
    """
    builder, scenario, calibration = wiring.builder, wiring.scenario, wiring.calibration
    (camera,) = calibration.cameras.values()
    looker, toucher = calibration.arms[CAMERA_ARM], calibration.arms[TOUCH_ARM]
    arm_with_camera, arm_with_taxels = ArmModel(looker.model), ArmModel(toucher.model)
    X_EC = camera.X_PC.GetAsMatrix4()
    perception, layout = scenario.perception, gripper_taxels()
    closed = layout.p_FS + layout.finger_places(np.zeros(2))[layout.finger]
    # Where the taxels are believed to be; their true places are those of the simulated gripper.
    shift = scenario.sensors.taxel_places * make_generator(
        scenario.seed, "taxel places"
    ).standard_normal(3)
    tips = [k for k, array in enumerate(layout.array) if ARRAYS[array].endswith("tip")]
    measurements = builder.AddNamedSystem(
        "pose_measurements",
        PoseMeasurements(
            model,
            CameraOnArm(
                intrinsics=camera.intrinsics,
                pose=lambda q: arm_with_camera.Evaluate(np.append(q, np.zeros_like(q))).X_WE @ X_EC,
                joints=arm_with_camera.num_joints,
                base=looker.X_WBase.GetAsMatrix4(),
                base_covariance=looker.covariance,
                pose_covariance=camera.pose_covariance,
                depth_scale_std=camera.depth_scale_std,
                focal_length_std=camera.focal_length_std,
            ),
            TaxelsOnArm(
                pose=lambda q: arm_with_taxels.Evaluate(np.append(q, np.zeros_like(q))).X_WE.copy(),
                base=toucher.X_WBase.GetAsMatrix4(),
                base_covariance=toucher.covariance,
                p_ES=closed + shift,
                radius=RADIUS,
                place_std=perception.taxel_places,
                ends=np.array(tips),
                threshold=scenario.control.touch.threshold,
                sigma=perception.contact_sigma,
            ),
            calibration.noise,
            None if table is None else table.height,
            perception.view,
            scenario.network_period,
        ),
    )
    inputs = {
        "pose_guess": guess,
        "depth_measured": sensors.depth,
        "camera_joint_state_measured": sensors.encoders[CAMERA_ARM].GetOutputPort(
            "joint_state_measured"
        ),
        "looked": control.look.GetOutputPort("looked"),
        "unreachable": control.look.GetOutputPort("unreachable"),
        "touch_end": control.touch.GetOutputPort("touch_end"),
    }
    for port, source in inputs.items():
        builder.Connect(source, measurements.GetInputPort(port))
    return measurements
