"""What the robots of the flap application believe of their camera and their arms."""

import numpy as np

from crossmodal.diagrams.flap.robot_config import ROBOTS
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.believed_robots import believed_robots

# What is left of an encoder's offset behind the gears once the joints are mastered, [rad].
_JOINT_OFFSET = float(np.deg2rad(0.05))


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arms as scenario and seed place them, and how well that is taken to be known."""
    cameras = scenario.drawn_cameras()
    return believed_robots(scenario, scenario.plant.scene, ROBOTS, cameras, _JOINT_OFFSET)
