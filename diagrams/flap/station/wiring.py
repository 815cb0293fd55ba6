"""What the functions that build a station share."""

from dataclasses import dataclass

from pydrake.geometry import GeometryId, Role
from pydrake.multibody.tree import Frame, RevoluteJoint
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.flap.robot_config import FINGERTIP, TOOL
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.settling import Start
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.plants.scene import ManipulationScene
from crossmodal.plants.tools.wiper import HINGE


@dataclass(kw_only=True)
class StationWiring:
    """Shared by the functions that build the station, in order.

    Attributes:
        builder: Of the station.
        scene: What is simulated.
        scenario: Of sensors and controllers, with the seed of all noise.
        calibration: What the robots believe.
        start: The true state at first.
    """

    builder: DiagramBuilder
    scene: ManipulationScene
    scenario: Scenario
    calibration: Calibration
    start: Start

    @property
    def fingertip(self) -> Frame:
        """S, the fingertip's frame."""
        return self.scene.plant.GetFrameByName("end_effector", self.scene.model(FINGERTIP))

    @property
    def skin(self) -> GeometryId:
        """The fingertip's soft shape."""
        frame = self.scene.plant.GetBodyFrameIdOrThrow(self.fingertip.body().index())
        inspector = self.scene.scene_graph.model_inspector()
        return inspector.GetGeometryIdByName(frame, Role.kProximity, f"{FINGERTIP}::tip")

    @property
    def hinge(self) -> RevoluteJoint:
        """Of the flap."""
        joint = self.scene.plant.GetJointByName(HINGE, self.scene.model(TOOL))
        assert isinstance(joint, RevoluteJoint)
        return joint
