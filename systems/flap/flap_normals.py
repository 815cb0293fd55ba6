"""Normals of a flap that turn about its hinge."""

import numpy as np

from crossmodal.maths.arrays import Array


def turned_normal(k: Array, n0: Array, angle: float) -> Array:
    """The normal (3,) turned by an angle about k, without its part along k (Rodrigues)."""
    n = n0 - k * (k @ n0)
    n = n / np.linalg.norm(n)
    return np.asarray(n * np.cos(angle) + np.cross(k, n) * np.sin(angle))


def angle_about(k: Array, n0: Array, n: Array) -> float:
    """Angle from n0 to n (3,) about k, within ±pi, [rad]."""
    return float(np.arctan2(k @ np.cross(n0, n), n0 @ n - (k @ n0) * (k @ n)))
