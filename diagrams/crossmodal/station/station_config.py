"""What a station is made of, and what the functions that build it share."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from controllers.arm.impedance import ImpedanceConfig
from controllers.interaction.bending_excitation import BendingExcitationConfig
from controllers.interaction.exploration import ExplorationConfig
from controllers.interaction.grasp_decisions import Goal
from controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from controllers.interaction.pull_direction import PullDirectionConfig
from controllers.interaction.trajectory_generator import TrajectoryGeneratorConfig
from plants.hands.pneumatic_hand import PneumaticHandConfig
from plants.scene import ManipulationScene, PlantConfig
from systems.sensors.air_pressure import PressureSensorConfig
from systems.sensors.joint_encoders import JointEncodersConfig
from systems.sensors.rgbd_camera import CameraNoiseConfig
from systems.sensors.robot_mask import RobotMaskConfig
from systems.sensors.wrist_wrench import WristWrenchConfig

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
    # Moves the hand about the object, which is then locked, to learn how the hand bends.
    excitation: BendingExcitationConfig | None = None
    # Posture (n,) near that of the taught grasp and far from the joints' limits, [rad].
    posture: np.ndarray = field(
        default_factory=lambda: np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.0])
    )
    # Errors with which a person guides the hand to the handle.
    guidance_translation: float = 0.004  # Standard deviation, [m].
    guidance_rotation: float = 0.03  # Standard deviation, [rad].


@dataclass(kw_only=True)
class StationConfig:
    plant: PlantConfig = field(default_factory=PlantConfig)
    hand: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    goal: Goal = field(default_factory=Goal)


@dataclass(kw_only=True)
class StationWiring:
    """Shared by the functions that build the station, in order.

    Attributes:
        builder: Of the station.
        scene: What is simulated.
        true_arm: The arm alone, the hand a rigid load, as it is.
        arm: The same as the robot believes it to be, with
        X_WBase: the pose of its base.
        config: Of plant, sensors and controllers.
        seed: Of all noise.
    """

    builder: DiagramBuilder
    scene: ManipulationScene
    true_arm: MultibodyPlant
    arm: MultibodyPlant
    X_WBase: RigidTransform
    config: StationConfig
    seed: int
