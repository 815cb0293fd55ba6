"""The gripper with two fingers and 140 taxels: its joints, and its taxels' shapes in a plant."""

from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from crossmodal.models import SDF_DIR
from crossmodal.models.gripper_taxels import FINGERS, gripper_taxels

GRIPPER_FILE = SDF_DIR / "two_finger_gripper.sdf"
JOINTS = [f"{finger}_joint" for finger in FINGERS]
BODIES = [f"{finger}_finger" for finger in FINGERS]


def taxel_shapes(
    plant: MultibodyPlant, inspector: SceneGraphInspector, gripper: ModelInstanceIndex
) -> list[GeometryId]:
    """The shapes of the taxels (140,), in the order of `gripper_taxels`.

    Args:
        plant: With the gripper.
        inspector: Of the plant's scene.
        gripper: Its model instance.
    """
    bodies = (plant.GetBodyByName(name, gripper) for name in BODIES)
    shapes = [shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    named = {inspector.GetName(shape).split("::")[-1]: shape for shape in shapes}
    return [named[name] for name in gripper_taxels().names]
