"""The robot of the cross-modal application: its sensors and its controllers."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.controllers.arm.impedance import ImpedanceConfig
from crossmodal.controllers.interaction.bending_excitation import BendingExcitationConfig
from crossmodal.controllers.interaction.exploration import ExplorationConfig
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.controllers.interaction.pull_direction import PullDirectionConfig
from crossmodal.controllers.interaction.trajectory_generator import TrajectoryGeneratorConfig
from crossmodal.maths.validation import number, numbers
from crossmodal.systems.sensors.air_pressure import PressureSensorConfig
from crossmodal.systems.sensors.joint_encoders import JointEncodersConfig
from crossmodal.systems.sensors.rgbd_camera import CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import RobotMaskConfig
from crossmodal.systems.sensors.wrist_wrench import WristWrenchConfig

# Model instances of the scene.
ARM, HAND, OBJECT = "arm", "hand", "object"


@dataclass(kw_only=True)
class SensorsConfig:
    camera: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    encoders: JointEncodersConfig = field(default_factory=JointEncodersConfig)
    wrench: WristWrenchConfig = field(default_factory=WristWrenchConfig)
    pressure: PressureSensorConfig = field(default_factory=PressureSensorConfig)
    robot_mask: RobotMaskConfig = field(default_factory=RobotMaskConfig)


@dataclass(kw_only=True)
class ControlConfig:
    sequence: GraspSequenceConfig = field(default_factory=GraspSequenceConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    pull_direction: PullDirectionConfig = field(default_factory=PullDirectionConfig)
    impedance: ImpedanceConfig = field(default_factory=ImpedanceConfig)
    trajectory: TrajectoryGeneratorConfig = field(default_factory=TrajectoryGeneratorConfig)
    # With this the object is locked and the hand moves about it, to learn how it bends.
    excitation: BendingExcitationConfig | None = None
    # Posture (7,) near the taught grasp's, far from the joints' limits on all of the way.
    posture: np.ndarray = numbers(
        np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.0]), at_least=-10.0, at_most=10.0, unit="rad"
    )
    # How well a person guides the hand to the handle, 1 sigma.
    guidance_translation: float = number(0.004, at_least=0.0, at_most=1.0, unit="m")
    # How well a person turns the hand to it, 1 sigma.
    guidance_rotation: float = number(0.03, at_least=0.0, at_most=3.2, unit="rad")
