"""What one touch of a gripper's taxels has measured: points, and space that was free."""

import numpy as np

from crossmodal.maths.arrays import Array, Ids

BEFORE_CONTACT = 4e-3  # Of a swept line is not known to be free, [m].


def contact_points(
    X_WE: Array, p_ES: Array, forces: Array, radius: float, threshold: float
) -> tuple[Array, Array]:
    """Where pressed taxels touch, and the normals of what they touch.

    The force on a taxel, a small sphere, pushes it away from what it touches, up to friction.

    Args:
        X_WE: Pose of the gripper (4, 4).
        p_ES: Middles of the spheres (T, 3), in E, [m].
        forces: On the taxels (T, 3), in E, [N].
        radius: Of the spheres, [m].
        threshold: Less force than this, [N], is none.

    Returns:
        Points and unit normals (N, 3), in W.
    """
    size = np.linalg.norm(forces, axis=1)
    pressed = size > threshold
    n_E = forces[pressed] / size[pressed, None]
    points = (p_ES[pressed] - radius * n_E) @ X_WE[:3, :3].T + X_WE[:3, 3]
    return points, n_E @ X_WE[:3, :3].T


def swept_lines(X_start: Array, X_end: Array, p_ES: Array, ends: Ids, met: bool) -> Array:
    """Start and end (R, 2, 3) in W of the lines along which taxels went without touching anything.

    Args:
        X_start: Pose of the gripper (4, 4) where the approach began.
        X_end: Where it ended.
        p_ES: Middles of the spheres (T, 3), in E, [m].
        ends: Which of them sweep the space, by index.
        met: Whether it ended at a contact.
    """
    starts = p_ES[ends] @ X_start[:3, :3].T + X_start[:3, 3]
    stops = p_ES[ends] @ X_end[:3, :3].T + X_end[:3, 3]
    return shortened(starts, stops, BEFORE_CONTACT if met else 0.0)


def shortened(starts: Array, stops: Array, by: float) -> Array:
    """Lines (R, 2, 3) between points (N, 3), without their last part; none where nothing is left.

    Args:
        by: Length of the last part, [m].
    """
    way = stops - starts
    length = np.linalg.norm(way, axis=1)
    left = length > by
    share = 1.0 - by / length[left]
    return np.stack([starts[left], starts[left] + share[:, None] * way[left]], axis=1)
