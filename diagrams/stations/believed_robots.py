"""What the robots of a scenario believe of their cameras and their arms."""

from collections.abc import Mapping

import numpy as np

from crossmodal.diagrams.run.calibration import (
    ArmCalibration,
    Calibration,
    calibrated,
    pose_covariance,
)
from crossmodal.diagrams.run.scenario import CameraConfig, Scenario
from crossmodal.plants.robots.arm_with_hand import ArmWithHand, make_arm_with_load
from crossmodal.plants.scene import nominal_pose


def believed_robots(
    scenario: Scenario,
    scene: str,
    robots: Mapping[str, ArmWithHand],
    cameras: Mapping[str, CameraConfig],
    joint_offset: float,
) -> Calibration:
    """Cameras and arms as scene and scenario place them, and how well that is taken to be known.

    Args:
        scenario: With what is believed of calibration and noise.
        scene: File in which the arms stand.
        robots: By the names of their arms in it.
        cameras: By name.
        joint_offset: Standard deviation of each encoder's constant offset, [rad].
    """
    believed, arms = scenario.calibration.believed, {}
    for name, robot in robots.items():
        X_WBase = nominal_pose(scene, "base", name)
        model = make_arm_with_load(robot, X_WBase)
        arms[name] = ArmCalibration(
            model=model,
            X_WBase=X_WBase,
            covariance=pose_covariance(believed.arm_rotation, believed.arm_translation),
            joint_offset_std=np.full(model.num_positions(), joint_offset),
        )
    return Calibration(
        cameras={name: calibrated(camera.camera(), believed) for name, camera in cameras.items()},
        arms=arms,
        noise=scenario.calibration.noise,
    )
