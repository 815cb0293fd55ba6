"""What the robot of the cross-modal application believes of its camera and arm."""

import numpy as np

from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.believed_robots import believed_robots
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND

# What an encoder on the motor's side of an elastic cable is taken to be off by, [rad].
_JOINT_OFFSET = float(np.deg2rad(3.0))


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arm as the scenario places them, and how well that is taken to be known."""
    robots = {ARM: WAM_WITH_SOFT_HAND}
    return believed_robots(scenario, scenario.plant.scene, robots, scenario.cameras, _JOINT_OFFSET)
