"""The robots of the clutter application: their names, sensors and controllers."""

from dataclasses import dataclass, field

from crossmodal.controllers.arm.motion_planner import MotionPlannerConfig
from crossmodal.controllers.primitives.guarded_touch import GuardedTouchConfig
from crossmodal.controllers.primitives.look import LookConfig
from crossmodal.controllers.primitives.move_object_config import MoveObjectConfig
from crossmodal.maths.validation import number
from crossmodal.plants.robots.panda import PANDA_WITH_CAMERA
from crossmodal.plants.robots.ur5 import UR5_WITH_GRIPPER
from crossmodal.systems.declutter.arm_offset import ArmOffsetConfig
from crossmodal.systems.grasping.grasp_planner import GraspPlannerConfig
from crossmodal.systems.pose.target_view import TargetViewConfig
from crossmodal.systems.registration.arm_registration import ArmRegistrationConfig
from crossmodal.systems.segmentation.segmenter import SegmenterConfig
from crossmodal.systems.sensors.finger_encoders import FingerEncodersConfig
from crossmodal.systems.sensors.joint_encoders import JointEncodersConfig, joint_side_encoders
from crossmodal.systems.sensors.rgbd_camera import CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import RobotMaskConfig
from crossmodal.systems.sensors.taxel_array import TaxelArrayConfig

# Model instances of the scene, and what the ports of the two arms begin with.
CAMERA_ARM, CAMERA_HAND, TOUCH_ARM, GRIPPER = "camera_arm", "camera_hand", "touch_arm", "gripper"
LOOKER, TOUCHER, OBJECT = "camera", "touch", "object"
ROBOTS = {CAMERA_ARM: PANDA_WITH_CAMERA, TOUCH_ARM: UR5_WITH_GRIPPER}


@dataclass(kw_only=True)
class SensorsConfig:
    camera: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    encoders: JointEncodersConfig = field(default_factory=joint_side_encoders)
    fingers: FingerEncodersConfig = field(default_factory=FingerEncodersConfig)
    robot_mask: RobotMaskConfig = field(default_factory=lambda: RobotMaskConfig(margin=0.015))
    taxels: TaxelArrayConfig = field(default_factory=TaxelArrayConfig)
    # By which all taxels are displaced on the fingers, along each axis; the standard deviation.
    taxel_places: float = number(5e-4, at_least=0.0, at_most=0.1, unit="m")


@dataclass(kw_only=True)
class PerceptionConfig:
    """How measurements are made of what the sensors give."""

    view: TargetViewConfig = field(default_factory=TargetViewConfig)
    segmenter: SegmenterConfig = field(default_factory=SegmenterConfig)
    grasps: GraspPlannerConfig = field(default_factory=GraspPlannerConfig)
    registration: ArmRegistrationConfig = field(default_factory=ArmRegistrationConfig)
    arm_offset: ArmOffsetConfig = field(default_factory=ArmOffsetConfig)
    # By how much a touch moves the object, as it is believed, times its mass: what the arm still
    # does until it stops is lost in friction. The standard deviation; .15 mm for .65 kg.
    moved: float = number(1e-4, at_least=0.0, at_most=0.1, unit="kg m")
    # By which all taxels are displaced, as it is believed.
    taxel_places: float = number(5e-4, at_least=0.0, at_most=0.1, unit="m")


@dataclass(kw_only=True)
class ControlConfig:
    look: LookConfig = field(default_factory=LookConfig)
    touch: GuardedTouchConfig = field(default_factory=GuardedTouchConfig)
    move: MoveObjectConfig = field(default_factory=MoveObjectConfig)
    planner: MotionPlannerConfig = field(default_factory=MotionPlannerConfig)
