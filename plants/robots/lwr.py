"""The seven-joint KUKA LWR 4, with a hand that holds a tool or with a tactile fingertip."""

from crossmodal.models import SDF_DIR
from crossmodal.plants.robots.arm_with_hand import ArmWithHand

ARM_JOINTS = [f"joint_{number}" for number in range(1, 8)]
LWR_WITH_THREE_FINGERS = ArmWithHand(
    arm=SDF_DIR / "lwr_arm.sdf",
    hand=SDF_DIR / "three_finger_hand.sdf",
    mount="palm",
    hand_frames=("end_effector",),
)
LWR_WITH_FINGERTIP = ArmWithHand(
    arm=SDF_DIR / "lwr_arm.sdf",
    hand=SDF_DIR / "tactile_fingertip.sdf",
    mount="finger",
    hand_frames=("end_effector",),
)
