"""The gripper with two fingers and 140 taxels: its joints, and its fingers' shapes in a plant."""

from dataclasses import dataclass

from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from crossmodal.models import SDF_DIR
from crossmodal.models.gripper_taxels import FINGERS, gripper_taxels

GRIPPER_FILE = SDF_DIR / "two_finger_gripper.sdf"
JOINTS = [f"{finger}_joint" for finger in FINGERS]
BODIES = [f"{finger}_finger" for finger in FINGERS]


@dataclass(frozen=True, kw_only=True)
class FingerShapes:
    """The shapes of the gripper's fingers.

    Attributes:
        taxels: Of the taxels (140,), in the order of `gripper_taxels`.
        cores: Of what carries them, in the order of `FINGERS`.
    """

    taxels: tuple[GeometryId, ...]
    cores: tuple[GeometryId, ...]


def finger_shapes(
    plant: MultibodyPlant, inspector: SceneGraphInspector, gripper: ModelInstanceIndex
) -> FingerShapes:
    """The shapes of the fingers in a plant.

    Args:
        plant: With the gripper.
        inspector: Of the plant's scene.
        gripper: Its model instance.
    """
    named = [
        {
            inspector.GetName(shape).split("::")[-1]: shape
            for shape in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(body, gripper))
        }
        for body in BODIES
    ]
    layout = gripper_taxels()
    return FingerShapes(
        taxels=tuple(named[f][name] for f, name in zip(layout.finger, layout.names, strict=True)),
        cores=tuple(shapes["core"] for shapes in named),
    )
