"""Targets of simple shapes."""

import numpy as np
import trimesh

from crossmodal.systems.pose.target_model import TargetModel, make_target

HALF = np.array([0.03, 0.05, 0.10])  # Edges of the box.
RADIUS = 0.05  # Of the ball.


def target(mesh: trimesh.Trimesh) -> TargetModel:
    return make_target(mesh.vertices, mesh.faces)
