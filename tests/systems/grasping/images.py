"""Depth images of flat things on a table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.pinhole import Intrinsics

CAMERA = Intrinsics(
    width=640, height=480, focal_x=577.0, focal_y=577.0, center_x=319.5, center_y=239.5
)


@dataclass(frozen=True, kw_only=True)
class Block:
    """A box whose edges are parallel to x and y of W turned by an angle."""

    middle: tuple[float, float]
    size: tuple[float, float, float]
    angle: float = 0.0


def above(distance: float, tilt: float = 0.0) -> Array:
    """X_WC (4, 4) of a camera that looks at the origin, tilted about y."""
    X_WC = np.eye(4)
    X_WC[:3, :3] = Rotation.from_euler("YX", [tilt, np.pi]).as_matrix()
    X_WC[:3, 3] = -distance * X_WC[:3, 2]
    return X_WC


def image_of(blocks: Sequence[Block], X_WC: Array, table: float = 0.0) -> tuple[Array, Ids]:
    """Depth and labels (H, W) of the tops of blocks on a table; their sides are not seen."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    x, y = (u - CAMERA.center_x) / CAMERA.focal_x, (v - CAMERA.center_y) / CAMERA.focal_y
    rays = np.stack([x, y, np.ones_like(x)], -1) @ X_WC[:3, :3].T
    depth = (table - X_WC[2, 3]) / rays[..., 2]
    labels = np.full(depth.shape, -1)
    for number, block in enumerate(blocks):
        far = (table + block.size[2] - X_WC[2, 3]) / rays[..., 2]
        p = (X_WC[:3, 3] + far[..., None] * rays)[..., :2] - block.middle
        c, s = np.cos(block.angle), np.sin(block.angle)
        inside = (np.abs(p @ [[c, -s], [s, c]]) <= 0.5 * np.array(block.size[:2])).all(axis=-1)
        depth[inside & (far < depth)] = far[inside & (far < depth)]
        labels[inside] = number
    return depth, labels
