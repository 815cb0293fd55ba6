"""What is measured of the object with the robots' sensors, as the robots believe these to be."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import OutputPort, System

from crossmodal.diagrams.clutter.robot_config import CAMERA_ARM, TOUCH_ARM
from crossmodal.diagrams.clutter.scenario import Scenario, is_transparent, target_name
from crossmodal.diagrams.clutter.station.robot_control import RobotControl
from crossmodal.diagrams.clutter.station.robot_sensors import RobotSensors
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.believed import arm_pose
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.models.gripper_taxels import (
    RADIUS,
    TIP_STICKS_OUT,
    gripper_taxels,
    tip_taxels,
)
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.pose_measurements import (
    CameraOnArm,
    PoseMeasurements,
    TaxelsOnArm,
)
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.sensors.randomness import make_generator


def believed_camera(calibration: Calibration) -> CameraOnArm:
    """The camera on its arm."""
    (camera,) = calibration.cameras.values()
    return CameraOnArm(
        intrinsics=camera.intrinsics,
        arm=arm_pose(calibration, CAMERA_ARM),
        pose_covariance=camera.pose_covariance,
        depth_scale_std=camera.depth_scale_std,
        focal_length_std=camera.focal_length_std,
    )


def believed_taxels(scenario: Scenario, calibration: Calibration) -> TaxelsOnArm:
    """The taxels on the closed gripper, whose places are known up to a common shift.

    The true places are those of the simulated gripper; the seed draws by how much what is believed
    differs from them.
    """
    layout, perception = gripper_taxels(), scenario.perception
    rng = make_generator(scenario.seed, "taxel places")
    shift = scenario.sensors.taxel_places * rng.standard_normal(3)
    closed = layout.p_FS + layout.finger_places(np.zeros(2))[layout.finger]
    return TaxelsOnArm(
        arm=arm_pose(calibration, TOUCH_ARM),
        p_ES=closed + shift,
        radius=RADIUS,
        place_std=perception.taxel_places,
        ends=tip_taxels(),
        threshold=scenario.control.touch.threshold,
        # What is thin may touch the skin between taxels at a finger's end, which is farther back.
        sigma=float(np.hypot(scenario.touches.touch.sigma, TIP_STICKS_OUT / np.sqrt(12.0))),
    )


def add_measurements(
    wiring: StationWiring,
    model: TargetModel,
    table: Table | None,
    camera: CameraOnArm,
    taxels: TaxelsOnArm,
    sensors: RobotSensors,
    guess: OutputPort,
    control: RobotControl,
) -> System:
    """Adds what makes measurements of the object's pose of what the sensors give.

    Args:
        model: Of the object.
        table: As believed.
        camera: As believed.
        taxels: As believed.
        sensors: Of the robots.
        guess: `pose_guess`.
        control: What moves the arms, and knows when they are where they should be.
    """
    builder, scenario, calibration = wiring.builder, wiring.scenario, wiring.calibration
    view = scenario.perception.view
    measurements = builder.AddNamedSystem(
        "pose_measurements",
        PoseMeasurements(
            model,
            camera,
            taxels,
            calibration.noise,
            None if table is None else table.height,
            replace(view, lines=0) if is_transparent(scenario) else view,
            scenario.network_period,
            target_name(scenario),
        ),
    )
    looker = sensors.encoders[CAMERA_ARM]
    inputs = {
        "pose_guess": guess,
        "depth_measured": sensors.depth,
        "robot_mask": sensors.mask,
        "camera_joint_state_measured": looker.GetOutputPort("joint_state_measured"),
        "looked": control.look.GetOutputPort("looked"),
        "unreachable": control.look.GetOutputPort("unreachable"),
        "touch_end": control.touch.GetOutputPort("touch_end"),
    }
    for port, source in inputs.items():
        builder.Connect(source, measurements.GetInputPort(port))
    return measurements
