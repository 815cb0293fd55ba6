"""Keeps the two sides of a sheet apart, which models draw twice, once for each side's colour."""

import numpy as np

from crossmodal.maths.arrays import Ids, Mask
from crossmodal.plants.object_import.meshes import Surface

# Less than a camera sees, more than a depth buffer confuses, [m].
_GAP = 1e-4
_SAME = 1e-6  # Corners nearer than this are one, as a share of the mesh's extent.


def with_sides_apart(surfaces: list[Surface]) -> list[Surface]:
    """The surfaces, each side of a sheet moved out by `_GAP` where another surface is the other.

    ShapeNet and what is made of it (PartNet-Mobility) have a triangle of another material behind
    each triangle, for renderers that draw a triangle only as seen from its front. Drake's draws
    both, so that they would flicker through each other, and no feature would stay in its place.

    Args:
        surfaces: Of one mesh file.
    """
    moved = []
    for surface, doubled in zip(surfaces, _doubled(surfaces), strict=True):
        mesh = surface.mesh
        if doubled.any():
            mesh = mesh.copy()
            vertices, normals = np.array(mesh.vertices), mesh.vertex_normals
            corners = np.unique(mesh.faces[doubled])
            vertices[corners] += _GAP * normals[corners]
            mesh.vertices = vertices
        moved.append(Surface(mesh=mesh, color=surface.color, texture=surface.texture))
    return moved


def _doubled(surfaces: list[Surface]) -> list[Mask]:
    """Which triangles of each surface have one of another surface behind them."""
    triangles = np.concatenate([surface.mesh.triangles for surface in surfaces])
    owner = np.repeat(np.arange(len(surfaces)), [len(surface.mesh.faces) for surface in surfaces])
    step = _SAME * float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    corners: Ids = np.unique(
        np.round(triangles.reshape(-1, 3) / step).astype(np.int64), axis=0, return_inverse=True
    )[1].reshape(-1, 3)
    # Two triangles of the same corners face apart if their corners go round the other way.
    a, b, c = corners.T
    side = ((b - a) * (c - b) * (c - a) > 0).astype(np.int64)
    place = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)[1].ravel()
    here, there = 2 * place + side, 2 * place + (1 - side)
    sides = 2 * (int(place.max()) + 1)
    behind = np.bincount(here, minlength=sides)[there]
    own, counts = np.unique(owner * sides + here, return_counts=True)
    found = np.minimum(np.searchsorted(own, owner * sides + there), len(own) - 1)
    of_itself = np.where(own[found] == owner * sides + there, counts[found], 0)
    ends = np.cumsum(np.bincount(owner, minlength=len(surfaces)))[:-1]
    return list(np.split(behind > of_itself, ends))
