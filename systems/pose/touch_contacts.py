"""What one touch of a gripper's taxels has measured: points, and space that was free."""

import numpy as np

from crossmodal.maths.arrays import Array, Ids

_STEP, _BEFORE_CONTACT = 6e-3, 4e-3  # Between samples of free space, and before its end, [m].


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


def swept_rays(X_start: Array, X_end: Array, p_ES: Array, ends: Ids, met: bool) -> list[Array]:
    """Samples (S, 3) in W of the lines along which some taxels went without touching anything.

    Args:
        X_start: Pose of the gripper (4, 4) where the approach began.
        X_end: Where it ended.
        p_ES: Middles of the spheres (T, 3), in E, [m].
        ends: Which of them sweep the space, by index.
        met: Whether it ended at a contact.
    """
    starts = p_ES[ends] @ X_start[:3, :3].T + X_start[:3, 3]
    stops = p_ES[ends] @ X_end[:3, :3].T + X_end[:3, 3]
    rays = []
    for start, stop in zip(starts, stops, strict=True):
        length = float(np.linalg.norm(stop - start))
        free = length - _BEFORE_CONTACT * met
        if free > 0.0:
            along = np.arange(0.0, free, _STEP) / length
            rays.append(start + along[:, None] * (stop - start))
    return rays
