"""The seven-joint Barrett WAM with a soft hand."""

from crossmodal.models import SDF_DIR
from crossmodal.plants.hands.soft_hand import HAND_FILE
from crossmodal.plants.robots.arm_with_hand import ArmWithHand

ARM_JOINTS = [f"joint_{number}" for number in range(1, 8)]
WAM_WITH_SOFT_HAND = ArmWithHand(arm=SDF_DIR / "wam_arm.sdf", hand=HAND_FILE)
