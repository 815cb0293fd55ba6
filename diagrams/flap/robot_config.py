"""The robots of the flap application: their names and their sensors."""

from dataclasses import dataclass, field

from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP, LWR_WITH_THREE_FINGERS
from crossmodal.systems.sensors.joint_encoders import JointEncodersConfig, joint_side_encoders
from crossmodal.systems.sensors.rgbd_camera import CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import RobotMaskConfig
from crossmodal.systems.sensors.taxels import TaxelsConfig

# Model instances of the scene, and what the ports of the two robots begin with.
HOLDER_ARM, HOLDER_HAND, FINGER_ARM, FINGERTIP = (
    "holder_arm",
    "holder_hand",
    "finger_arm",
    "fingertip",
)
HOLDER, FINGER, TOOL = "holder", "finger", "tool"
ROBOTS = {HOLDER_ARM: LWR_WITH_THREE_FINGERS, FINGER_ARM: LWR_WITH_FINGERTIP}


@dataclass(kw_only=True)
class SensorsConfig:
    camera: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    encoders: JointEncodersConfig = field(default_factory=joint_side_encoders)
    taxels: TaxelsConfig = field(default_factory=TaxelsConfig)
    # The LWR knows its joints well, so that the mask needs no wide margin.
    robot_mask: RobotMaskConfig = field(default_factory=lambda: RobotMaskConfig(margin=0.015))
