"""What disturbs a camera: darkness, and things in front of it."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.scenario import Disturbances
from crossmodal.diagrams.stations.occurrence import occurs


class Lighting(LeafSystem):
    """Light and cover over time; the disturbances of a scenario.

    Output ports:
    - `illumination`: (1,) 1 normal, 0 lights off.
    - `cover`: (1,) 1 while something covers the camera.
    """

    def __init__(self, disturbances: Disturbances) -> None:
        super().__init__()

        def illumination(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, 1.0 - occurs(disturbances.lights_off, context.get_time()))

        def cover(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, occurs(disturbances.camera_covered, context.get_time()))

        self.DeclareVectorOutputPort("illumination", 1, illumination, {self.time_ticket()})
        self.DeclareVectorOutputPort("cover", 1, cover, {self.time_ticket()})
