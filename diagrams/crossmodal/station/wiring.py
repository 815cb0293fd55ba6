"""What the functions that build a station share."""

from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant

from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.run.calibration import ArmCalibration
from crossmodal.diagrams.stations import wiring


@dataclass(kw_only=True)
class StationWiring(wiring.StationWiring):
    """As in every station, and `true_arm`: the arm alone as it is, the hand a rigid load."""

    scenario: Scenario
    true_arm: MultibodyPlant

    @property
    def arm(self) -> ArmCalibration:
        """What the robot believes of the arm."""
        return self.calibration.arms[ARM]
