"""What is known of an object whose pose is sought: its surface, and how it may stand.

Frame O of the object is that of its mesh. Inside of this room the origin is moved to the middle of
the surface, so that a turn moves the object as little as possible; `TargetModel.middle` says where.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot
from crossmodal.maths.convex import steady_directions
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.pose.surface import Surface, make_surface, nearest_distances

_SAMPLES = 14_000  # About so many describe the surface,
_DENSER = 6  # chosen from so many times as many that none are near each other.
_SMALLEST, _LARGEST = 5e-3, 2.0  # Diagonals of what a robot handles, [m].
_SEED = 0  # The samples are the same each time.
_ALIKE_DIRECTIONS = 1e-2  # Angle up to which two directions count as one, [rad].
_TURNS = 13  # Parts of half a turn by which a symmetry is tried.
_ALIKE = 3e-4  # Largest mean distance between an object and itself, turned, that look alike, [m].


class TargetModelError(ValueError):
    """A mesh that cannot be a target."""


@dataclass(frozen=True, kw_only=True)
class TargetModel(Immutable):
    """What is known of an object.

    Attributes:
        surface: Relative to the middle.
        hull: Corners of the convex hull (H, 3), relative to the middle, [m].
        stable: Directions (S, 3) that point up where the object stands without leaning.
        spins: Projection (3, 3) on the axes through the middle about which the object may be turned
            by any angle and looks the same.
        middle: p_OM (3,) in the mesh's own frame, [m].
        radius: Of the sphere about the middle that holds all of it, [m].
    """

    surface: Surface
    hull: Array
    stable: Array
    spins: Array
    middle: Array
    radius: float


def load_target(path: str | Path, scale: float = 1.0) -> TargetModel:
    """The target that a mesh file describes, in any format that trimesh reads.

    Args:
        path: Of the file.
        scale: Metres per unit of the file.

    Raises:
        TargetModelError: if there is no such mesh, or none that can be a target.
    """
    vertices, triangles = read_mesh(path)
    return make_target(vertices * scale, triangles, str(path))


def read_mesh(path: str | Path) -> tuple[Array, Ids]:
    """Vertices (V, 3) in the file's unit, and triangles (T, 3).

    Raises:
        TargetModelError: if the file is not read as a mesh.
    """
    import trimesh

    try:
        mesh = trimesh.load(str(path), force="mesh")
    except Exception as error:  # Each format has errors of its own.
        raise TargetModelError(f"{path}: not read as a mesh: {error}") from None
    return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)


def make_target(vertices: Array, triangles: Ids, name: str = "the mesh") -> TargetModel:
    """The target that a closed surface describes.

    Args:
        vertices: (V, 3), [m].
        triangles: (T, 3) numbers of vertices. A surface that is inside out is turned.
        name: In what is said of a fault.

    Raises:
        TargetModelError: for an empty mesh, one with holes that cannot be closed, numbers that are
            not finite, and a size that no robot would handle, as from another unit.
    """
    import trimesh

    vertices = np.asarray(vertices, dtype=float).reshape(-1, 3)
    if len(vertices) == 0 or len(triangles) == 0:
        raise TargetModelError(f"{name}: holds no triangle")
    if not np.isfinite(vertices).all():
        raise TargetModelError(f"{name}: has vertices that are not finite")
    mesh = trimesh.Trimesh(vertices, triangles, process=True)
    mesh.merge_vertices()
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    if not _SMALLEST <= size <= _LARGEST:
        raise TargetModelError(
            f"{name}: is {size:.3g} m large, where {_SMALLEST:g} to {_LARGEST:g} m are expected;"
            " if its unit is not the metre, give its scale"
        )
    if not mesh.is_watertight:
        mesh.fill_holes()
    if not mesh.is_watertight:
        raise TargetModelError(
            f"{name}: its surface has {_open_edges(mesh)} open edges, so that inside and outside"
            " are not known; close it first"
        )
    mesh.fix_normals(multibody=True)
    spacing = float(np.sqrt(mesh.area / _SAMPLES))
    many, faces = trimesh.sample.sample_surface(mesh, _DENSER * _SAMPLES, seed=_SEED)[:2]
    kept = _thinned(np.asarray(many), spacing)
    points, normals = np.asarray(many)[kept], np.asarray(mesh.face_normals)[faces[kept]]
    middle, moments = _surface_moments(mesh)
    corners = np.asarray(mesh.triangles) - middle
    surface = make_surface(points - middle, normals, corners, spacing)
    hull = ConvexHull(mesh.vertices - middle)
    stable = steady_directions(hull, np.asarray(mesh.center_mass) - middle)
    return TargetModel(
        surface=surface,
        hull=np.ascontiguousarray(hull.points[hull.vertices]),
        stable=np.ascontiguousarray(stable[_thinned(stable, _ALIKE_DIRECTIONS)]),
        spins=_spins(moments, surface),
        middle=middle,
        radius=float(np.linalg.norm(mesh.vertices - middle, axis=1).max()),
    )


def _thinned(points: Array, apart: float) -> Mask:
    """Which points (N,) to keep, in their order, so that none is nearer than `apart` to another."""
    pairs = cKDTree(points).query_pairs(apart, output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return _first_of_each(pairs, np.ones(len(points), dtype=np.bool_))


@hot
def _first_of_each(pairs: Ids, kept: Mask) -> Mask:
    for i, j in pairs:
        if kept[i]:
            kept[j] = False
    return kept


def _open_edges(mesh: Any) -> int:
    edges = np.sort(mesh.edges, axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.sum(counts == 1))


def _surface_moments(mesh: Any) -> tuple[Array, Array]:
    """The middle (3,) of the surface and its second moments (3, 3) about that."""
    corners, areas = np.asarray(mesh.triangles), np.asarray(mesh.area_faces)
    middle = (areas @ corners.mean(axis=1)) / areas.sum()
    corners = corners - middle
    sums = corners.sum(axis=1)
    second = np.einsum("n,nki,nkj->ij", areas, corners, corners)
    return middle, (second + np.einsum("n,ni,nj->ij", areas, sums, sums)) / (12.0 * areas.sum())


def _spins(moments: Array, surface: Surface) -> Array:
    found = np.zeros((3, 3))
    for axis in np.linalg.eigh(moments)[1].T:
        turns = Rotation.from_rotvec(np.arange(1, _TURNS)[:, None] * (np.pi / _TURNS * axis))
        apart = [
            np.mean(nearest_distances(surface.points @ R.T, surface)) for R in turns.as_matrix()
        ]
        if max(apart) < _ALIKE:
            found += np.outer(axis, axis)
    return found
