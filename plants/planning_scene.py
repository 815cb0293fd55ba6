"""What robots know of the world that they move in: for collision checks, not for simulation."""

from pydrake.multibody.parsing import LoadModelDirectives, ProcessModelDirectives
from pydrake.planning import RobotDiagram, RobotDiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.parsing import make_parser


def planning_scene(scene: str) -> RobotDiagram:
    """The models of a scene, where its directives place them.

    Args:
        scene: File of directives in models/sdf, or an absolute path.
    """
    builder = RobotDiagramBuilder()
    plant = builder.plant()
    ProcessModelDirectives(LoadModelDirectives(str(SDF_DIR / scene)), make_parser(plant))
    plant.Finalize()
    return builder.Build()
