"""Targets of simple shapes."""

import numpy as np
import trimesh

from crossmodal.systems.pose.target_model import TargetModel, make_target

HALF = np.array([0.03, 0.05, 0.10])  # Half the edges of the box.
CORNERS = np.stack(np.meshgrid(*np.column_stack([-HALF, HALF])), axis=-1).reshape(-1, 3)
RADIUS = 0.05  # Of the ball.


def target(mesh: trimesh.Trimesh) -> TargetModel:
    return make_target(mesh.vertices, mesh.faces)


def touching(corners: np.ndarray, X: np.ndarray, eye: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Unit vectors (T, 3) in W of planes through an eye (3,) that a body touches from behind.

    Args:
        corners: Of its convex hull (N, 3), relative to its middle.
        X: Pose (4, 4) of its middle.
        eye: In W.
        angles: Of the planes (T,) about the line of sight to its middle.
    """
    rays = corners @ X[:3, :3].T + X[:3, 3] - eye
    axis = X[:3, 3] - eye
    e1, e2 = np.linalg.svd(axis[None])[2][1:]
    planes = []
    for angle in angles:
        way = np.cos(angle) * e1 + np.sin(angle) * e2
        # n = way - s axis, with the least s for which no corner is before the plane.
        n = way - np.max(rays @ way / (rays @ axis)) * axis
        planes.append(n / np.linalg.norm(n))
    return np.array(planes)
