"""What the robot of the cross-modal application believes of its camera and arm."""

import numpy as np

from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.run.calibration import (
    ArmCalibration,
    Calibration,
    calibrated,
    pose_covariance,
)
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import nominal_pose

# What an encoder on the motor's side of an elastic cable is taken to be off by, [rad].
_JOINT_OFFSET = np.deg2rad(3.0)


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arm as the scenario places them, and how well that is taken to be known."""
    believed = scenario.calibration.believed
    X_WBase = nominal_pose(scenario.plant.scene, "base", ARM)
    return Calibration(
        cameras={
            name: calibrated(camera.camera(), believed) for name, camera in scenario.cameras.items()
        },
        arms={
            ARM: ArmCalibration(
                model=make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
                X_WBase=X_WBase,
                covariance=pose_covariance(believed.arm_rotation, believed.arm_translation),
                joint_offset_std=np.full(len(ARM_JOINTS), _JOINT_OFFSET),
            )
        },
        noise=scenario.calibration.noise,
    )
