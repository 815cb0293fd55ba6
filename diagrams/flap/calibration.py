"""What the robots of the flap application believe of their camera and their arms."""

import numpy as np

from crossmodal.diagrams.flap.robot_config import ROBOTS
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.run.calibration import (
    ArmCalibration,
    Calibration,
    calibrated,
    pose_covariance,
)
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import ARM_JOINTS
from crossmodal.plants.scene import nominal_pose

# What is left of an encoder's offset behind the gears once the joints are mastered, [rad].
_JOINT_OFFSET = np.deg2rad(0.05)


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arms as scenario and seed place them, and how well that is taken to be known."""
    believed, arms = scenario.calibration.believed, {}
    for name, robot in ROBOTS.items():
        X_WBase = nominal_pose(scenario.plant.scene, "base", name)
        arms[name] = ArmCalibration(
            model=make_arm_with_load(robot, X_WBase),
            X_WBase=X_WBase,
            covariance=pose_covariance(believed.arm_rotation, believed.arm_translation),
            joint_offset_std=np.full(len(ARM_JOINTS), _JOINT_OFFSET),
        )
    cameras = {
        name: calibrated(config.camera(), believed)
        for name, config in scenario.drawn_cameras().items()
    }
    return Calibration(cameras=cameras, arms=arms, noise=scenario.calibration.noise)
