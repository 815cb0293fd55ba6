"""What a station is made of, and what the functions that build it share."""

from dataclasses import dataclass, field

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from controllers.interaction.grasp_decisions import Goal
from diagrams.crossmodal.robot_config import ControlConfig, SensorsConfig
from plants.hands.pneumatic_hand import PneumaticHandConfig
from plants.scene import ManipulationScene, PlantConfig


@dataclass(kw_only=True)
class StationConfig:
    plant: PlantConfig = field(default_factory=PlantConfig)
    hand: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    goal: Goal = field(default_factory=Goal)


@dataclass(kw_only=True)
class StationWiring:
    """Shared by the functions that build the station, in order."""

    builder: DiagramBuilder
    scene: ManipulationScene
    arm: MultibodyPlant
    config: StationConfig
    seed: int
