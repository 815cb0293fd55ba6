"""What the functions that build a station share."""

from dataclasses import dataclass

from pydrake.geometry import GeometryId, Role
from pydrake.multibody.tree import Frame, RevoluteJoint

from crossmodal.diagrams.flap.robot_config import FINGERTIP, TOOL
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.settling import Start
from crossmodal.diagrams.stations import wiring
from crossmodal.plants.tools.wiper import HINGE


@dataclass(kw_only=True)
class StationWiring(wiring.StationWiring):
    """As in every station, and `start`: the true state at first."""

    scenario: Scenario
    start: Start

    @property
    def fingertip(self) -> Frame:
        """S, the fingertip's frame."""
        return self.plant.GetFrameByName("end_effector", self.scene.model(FINGERTIP))

    @property
    def skin(self) -> GeometryId:
        """The fingertip's soft shape."""
        frame = self.plant.GetBodyFrameIdOrThrow(self.fingertip.body().index())
        inspector = self.scene.scene_graph.model_inspector()
        return inspector.GetGeometryIdByName(frame, Role.kProximity, f"{FINGERTIP}::tip")

    @property
    def hinge(self) -> RevoluteJoint:
        """Of the flap."""
        joint = self.plant.GetJointByName(HINGE, self.scene.model(TOOL))
        assert isinstance(joint, RevoluteJoint)
        return joint
