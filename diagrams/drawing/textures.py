"""Shows the textures of boxes in Meshcat, which draws Drake's own shapes in one colour."""

from functools import lru_cache

import numpy as np
import trimesh
from PIL import Image
from pydrake.geometry import Box, Mesh, Rgba, Role, SceneGraph
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from crossmodal.diagrams.drawing.meshcat import scene_path
from crossmodal.diagrams.drawing.text_board import in_memory

_PIXELS = 256  # Side of a texture: the page holds one for each box.


def textured_boxes(scene_graph: SceneGraph) -> dict[str, Mesh]:
    """What a Meshcat that shows a scene lacks: boxes with the textures that cameras see on them.

    They are not for the scene graph: a geometry more in there, if only for illustration, changes
    what cameras render.

    Returns:
        By the paths at which Drake's `MeshcatVisualizer` shows them in one colour.
    """
    inspector = scene_graph.model_inspector()
    boxes = {}
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        shape, seen = inspector.GetShape(geometry), inspector.GetPerceptionProperties(geometry)
        if seen is None or not isinstance(shape, Box):
            continue
        texture = seen.GetPropertyOrDefault("phong", "diffuse_map", "")
        if texture:
            tint = seen.GetPropertyOrDefault("phong", "diffuse", Rgba(1.0, 1.0, 1.0))
            path = scene_path(inspector, geometry)
            boxes[path] = textured_box(tuple(shape.size()), texture, (tint.r(), tint.g(), tint.b()))
    return boxes


@lru_cache(maxsize=64)
def textured_box(
    size: tuple[float, float, float], texture: str, tint: tuple[float, float, float]
) -> Mesh:
    """A box with a picture on each of its six sides, upright on those that stand.

    Args:
        size: Along x, y and z, [m].
        texture: File of the picture.
        tint: Red, green and blue, 0 to 1, by which the picture is multiplied.
    """
    with Image.open(texture) as image:
        pixels = np.asarray(image.convert("RGB").resize((_PIXELS, _PIXELS)))
    picture = Image.fromarray(np.round(pixels * np.array(tint)).astype(np.uint8))
    corners: list[np.ndarray] = []
    faces: list[tuple[int, int, int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            out = sign * np.eye(3)[axis]
            up = np.eye(3)[2 if axis < 2 else 0]
            right = np.cross(up, out)
            first = len(corners)
            corners += [out + u * right + v * up for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    x, y, z = (0.5 * np.asarray(size) * np.array(corners)).T
    box = trimesh.Trimesh(
        vertices=np.column_stack([x, z, -y]),
        faces=faces,
        visual=TextureVisuals(
            uv=[(0, 0), (1, 0), (1, 1), (0, 1)] * 6,
            material=PBRMaterial(baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=1.0),
        ),
        process=False,
    )
    return in_memory(box, texture)
