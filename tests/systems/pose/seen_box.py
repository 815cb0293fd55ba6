"""A box on a table, and the exact depth image that a camera takes of both."""

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics

EDGES = np.array([0.06, 0.1, 0.2])
MIDDLE = np.array([0.5, 0.0, 0.1])  # It stands on z = 0.
RADIUS = 0.5 * float(np.linalg.norm(EDGES))
INTRINSICS = Intrinsics(
    width=160, height=120, focal_x=180.0, focal_y=180.0, center_x=79.5, center_y=59.5
)
X_WC = se3.looking_at(np.array([0.2, -0.3, 0.4]), MIDDLE)


def pixel_rays() -> Array:
    """Of each pixel (H, W, 3), in C, with z = 1."""
    v, u = np.indices((INTRINSICS.height, INTRINSICS.width))
    x, y = (u - INTRINSICS.center_x) / 180.0, (v - INTRINSICS.center_y) / 180.0
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def to_box(eye: Array, directions: Array) -> Array:
    """Distances (N,), in lengths of the directions (N, 3), to the box; infinite for a miss."""
    with np.errstate(divide="ignore"):
        sides = (MIDDLE + np.array([[-0.5], [0.5]]) * EDGES - eye)[:, None] / directions
    enter, leave = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
    return np.where((enter < leave) & (enter > 0.0), enter, np.inf)


def depth_image(X: Array = X_WC) -> tuple[Array, Array]:
    """Depth (H, W), [m], by a camera at X (4, 4), and which pixels show the box."""
    directions = pixel_rays().reshape(-1, 3) @ X[:3, :3].T
    box = to_box(X[:3, 3], directions)
    with np.errstate(divide="ignore"):
        table = -X[2, 3] / directions[:, 2]
    table = np.where(table > 0.0, table, np.inf)
    depth = np.minimum(box, table)
    shape = (INTRINSICS.height, INTRINSICS.width)
    return np.where(depth < 3.0, depth, 0.0).reshape(shape), (box < table).reshape(shape)


def off_the_box(p: Array) -> Array:
    """Distances (N,) of points (N, 3) from the box's surface, [m]."""
    q = np.abs(p - MIDDLE) - 0.5 * EDGES
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
    return np.abs(outside + np.minimum(q.max(axis=1), 0.0))
