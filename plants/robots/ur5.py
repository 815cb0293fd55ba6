"""The six-joint Universal Robots UR5, with a gripper whose fingers feel."""

import numpy as np

from crossmodal.models import SDF_DIR
from crossmodal.plants.hands.taxel_gripper import GRIPPER_FILE
from crossmodal.plants.robots.arm_with_hand import ArmWithHand

ARM_JOINTS = [f"joint_{number}" for number in range(1, 7)]
UR5_WITH_GRIPPER = ArmWithHand(
    arm=SDF_DIR / "ur5_arm.sdf",
    hand=GRIPPER_FILE,
    mount="palm",
    hand_frames=("end_effector",),
)
# The gripper points down, above and beside what another arm looks at 0.5 m before this one, [rad].
UR5_HOME = np.array([-2.2, -2.2, 1.8, -1.2, -1.57, 0.0])
