"""Points as dots for Meshcat that stand out from whatever they lie on."""

import numpy as np
from pydrake.geometry import Meshcat, Rgba

from crossmodal.maths.arrays import Array

_OUTLINE = Rgba(0.06, 0.06, 0.06)
_OUTLINE_SCALE = 1.4  # The outline's radius, in those of the dot.
_CORNERS = np.vstack([np.eye(3), -np.eye(3)])
_FACES = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2),
                   (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])  # fmt: skip


def set_dots(meshcat: Meshcat, path: str, points: Array, radius: float, color: Rgba) -> None:
    """Draws points (n, 3), [m], as small bodies with a dark outline.

    The outline is a larger body of which only the far side is drawn.

    Args:
        radius: Of a dot without its outline, [m].
    """
    for name, size, shade, side in (
        ("dots", radius, color, Meshcat.SideOfFaceToRender.kFrontSide),
        ("outline", _OUTLINE_SCALE * radius, _OUTLINE, Meshcat.SideOfFaceToRender.kBackSide),
    ):
        corners = (points[:, None, :] + size * _CORNERS).reshape(-1, 3)
        faces = (len(_CORNERS) * np.arange(len(points))[:, None, None] + _FACES).reshape(-1, 3)
        meshcat.SetTriangleMesh(
            f"{path}/{name}",
            np.asfortranarray(corners.T),
            np.asfortranarray(faces.T.astype(np.int32)),
            shade,
            side=side,
        )
