"""What the functions that build a station share."""

from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.plants.scene import ManipulationScene


@dataclass(kw_only=True)
class StationWiring:
    """Shared by the functions that build a station, in order.

    Attributes:
        builder: Of the station.
        scene: What is simulated.
        scenario: Of sensors and controllers, with the seed of all noise and the network's period.
        calibration: What the robots believe.
    """

    builder: DiagramBuilder
    scene: ManipulationScene
    scenario: Scenario
    calibration: Calibration

    @property
    def plant(self) -> MultibodyPlant:
        """The simulated one."""
        return self.scene.plant
