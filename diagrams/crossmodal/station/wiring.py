"""What the functions that build a station share."""

from dataclasses import dataclass

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.plants.scene import ManipulationScene


@dataclass(kw_only=True)
class StationWiring:
    """Shared by the functions that build the station, in order.

    Attributes:
        builder: Of the station.
        scene: What is simulated.
        true_arm: The arm alone, the hand a rigid load, as it is.
        arm: The same as the robot believes it to be, with
        X_WBase: the pose of its base.
        scenario: Of sensors and controllers, with the seed of all noise.
    """

    builder: DiagramBuilder
    scene: ManipulationScene
    true_arm: MultibodyPlant
    arm: MultibodyPlant
    X_WBase: RigidTransform
    scenario: Scenario
