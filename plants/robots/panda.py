"""The seven-joint Franka Emika Panda, whose closed hand carries a camera."""

import numpy as np

from crossmodal.models import SDF_DIR
from crossmodal.plants.robots.arm_with_hand import ArmWithHand

ARM_JOINTS = [f"joint_{number}" for number in range(1, 8)]
PANDA_WITH_CAMERA = ArmWithHand(
    arm=SDF_DIR / "panda_arm.sdf",
    hand=SDF_DIR / "camera_hand.sdf",
    mount="mount",
    hand_frames=("end_effector", "camera"),
)
# The camera looks down from 0.5 m above (0.5, 0, 0) in the base's frame; its image has the arm's
# base below, [rad].
PANDA_HOME = np.array([0.0, -0.4, 0.0, -2.052, 0.0, 1.652, 0.0])
# The arm is turned aside, so that another one can reach what it has looked at, [rad].
PANDA_AWAY = PANDA_HOME + np.array([1.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
