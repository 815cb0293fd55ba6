"""Parts of a model that look like handles, and from where a hand comes to them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from trimesh.intersections import slice_mesh_plane

from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.bars import bar_at

SHORTEST, _LONGEST, _SLENDER = 0.08, 1.0, 2.0  # Of a handle, [m]; its length over its thickness.
_LEAST = 0.01  # Of a knob, [m].
_AROUND = 0.25  # Of a bar, what it may be fixed to and what may be in the way, to each side, [m].
_HAND = 0.05  # Half width of what must be free before a handle, [m].
_AHEAD = 0.2  # How far before it, [m].
_SAMPLES = 4000  # Of what may be in the way.
_TURN = np.pi / 8  # Between directions that are tried, [rad].
_ACROSS = np.sqrt(0.5)  # Least part of a bar's way that is across it.
_ASIDE = 0.5  # Most of an edge's way that is into its board, of its direction that is down.
_INSIDE = 0.02  # Of a board, between the fingers, from its edge on, [m].


@dataclass(frozen=True, kw_only=True)
class Going:
    """How a place moves with its joint.

    Attributes:
        way: Unit vector (3,) in which it can go; 0 for nowhere.
        rate: How fast it goes as the joint does, [m per m or rad].
        travel: How far it goes from the joint's 0 to its farther limit, along its path, [m].
        axis: Unit vector (3,) about which it turns; 0 for one that does not.
        both: Whether it can also go against `way`.
    """

    way: Array
    rate: float
    travel: float
    axis: Array
    both: bool


_Way = Callable[[Array], Going]


def bars_of(
    solid: trimesh.Trimesh, whole: trimesh.Trimesh, axes: Array, way: _Way
) -> Iterator[tuple[Array, float]]:
    """Pose (4, 4) and length [m] of each part that is long and thin, and that a hand gets to.

    In the pose y is along the bar, and x where the joint lets it go, as far as that is free. Short
    parts may be knobs.

    Args:
        solid: Of bodies that are fixed to each other.
        whole: Of the model, in the same frame.
        axes: Columns (3, 3), along which the bars' y rather point than against them.
        way: How a place (3,) can go.
    """
    parts = _parts(solid)
    for k, part in enumerate(parts):
        middle, y, length, width = _along(part)
        is_knob = _LEAST <= length < SHORTEST
        if not is_knob and not (SHORTEST <= length <= _LONGEST and length >= _SLENDER * width):
            continue
        others = [other for i, other in enumerate(parts) if i != k]
        going, x = way(middle), None
        if is_knob:
            middle, y, length, width = _along(part, going.way)
        y = y * np.sign(max(axes.T @ y, key=abs))
        # A lever reaches to its axis, and turns about the way out of what that is in.
        is_lever = 0.0 < going.rate <= length and bool(np.any(going.axis))
        for fixed_to in ([whole],) if is_lever else (others, [whole]):
            x = _out_of(_near(fixed_to, middle), middle, y) if x is None else x
        if not (is_lever and x is not None and abs(x @ going.axis) > _ACROSS):
            x = _let_go(x, y, going)
        if x is not None:
            x = _free(x, middle, y, 0.5 * width, _near([whole], middle))
        if x is not None:
            R = RotationMatrix.ProjectToRotationMatrix(np.column_stack([x, y, np.cross(x, y)]))
            X = RigidTransform(R, middle)
            X_inverse = X.inverse().GetAsMatrix4()
            # The middle of a bow is between its bar and what it is fixed to.
            bar = bar_at(part.copy().apply_transform(X_inverse), np.inf)
            if bar is not None:
                yield (X @ RigidTransform(bar.middle)).GetAsMatrix4(), length


def edges_of(
    solid: trimesh.Trimesh,
    whole: trimesh.Trimesh,
    axes: Array,
    way: _Way,
    least: float,
    most: float,
) -> Iterator[tuple[Array, float]]:
    """Pose (4, 4) and length [m] of the middle of each edge of a board that a hand gets to.

    In the pose x is out of the board and y along its edge. Those that move fastest come first.

    Args:
        solid: Of bodies that are fixed to each other.
        whole: Of the model, in the same frame.
        axes: Columns (3, 3), along which the boards are.
        way: As for `bars_of`.
        least: Least thickness of a board, [m].
        most: Its largest.
    """
    found = list[tuple[float, Array, float]]()
    for part in _parts(solid):
        inside = part.vertices @ axes
        size, middle = (
            np.ptp(inside, axis=0),
            axes @ (0.5 * (inside.min(axis=0) + inside.max(axis=0))),
        )
        thin = int(np.argmin(size))
        for out, along in permutations({0, 1, 2} - {thin}):
            if not (least <= size[thin] <= most and size[along] >= SHORTEST):
                continue
            for x in (axes[:, out], -axes[:, out]):
                y, place = axes[:, along], middle + (0.5 * size[out] - _INSIDE) * x
                going = way(place)
                is_held = abs(going.way @ y) < _ACROSS and going.way @ x > -_ASIDE
                is_below = x[2] < -_ASIDE
                if going.rate > 0.0 and is_held and not is_below:
                    around = _near([whole], place)
                    if _free(x, place, y, _INSIDE, around, turns=0) is not None:
                        X = np.eye(4)
                        X[:3] = np.column_stack([x, y, np.cross(x, y), place])
                        found.append((going.rate, X, float(size[along])))
    yield from (each[1:] for each in sorted(found, key=lambda each: -each[0]))


def _parts(solid: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """What hangs together, by vertices: many meshes have each triangle twice, once a side.

    Triangles alone, as where a mesh is torn, have no thickness and are left out.
    """
    vertices, faces = solid.vertices, solid.faces
    labels = trimesh.graph.connected_component_labels(solid.edges, len(vertices))[faces[:, 0]]
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order])) + 1
    parts = [trimesh.Trimesh(vertices, faces[one]) for one in np.split(order, starts)]
    return [part for part in parts if len(part.vertices) > 3]


def _along(part: trimesh.Trimesh, way: Array | None = None) -> tuple[Array, Array, float, float]:
    """Middle (3,) and direction (3,) of a part's longest extent, its length and its width, [m].

    Args:
        way: Unit vector (3,) across which the extent is to be; 0 or None for any.
    """
    spread = part.vertices - part.vertices.mean(axis=0)
    if way is not None:
        spread = spread - np.outer(spread @ way, way)
    _, _, axes = np.linalg.svd(spread, full_matrices=False)
    inside = part.vertices @ axes.T
    middle = 0.5 * (inside.min(axis=0) + inside.max(axis=0)) @ axes
    length, *others = np.ptp(inside, axis=0)
    return middle, axes[0], float(length), float(max(others))


def _near(solids: list[trimesh.Trimesh], middle: Array) -> trimesh.Trimesh:
    """What of solids is in a box around a place."""
    low, high = middle - _AROUND, middle + _AROUND
    parts = []
    for solid in solids:
        if solid.is_empty or (solid.bounds[1] < low).any() or (solid.bounds[0] > high).any():
            continue
        least, greatest = solid.triangles.min(axis=1), solid.triangles.max(axis=1)
        inside = ((greatest >= low) & (least <= high)).all(axis=1)
        if inside.any():
            parts.append(trimesh.Trimesh(solid.vertices, solid.faces[inside], process=False))
    near = trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()
    for normal in np.concatenate([np.eye(3), -np.eye(3)]):
        if not near.is_empty:
            near = slice_mesh_plane(near, normal, middle - _AROUND * normal)
    return near


def _out_of(solid: trimesh.Trimesh, middle: Array, y: Array) -> Array | None:
    """The direction (3,) across a bar in which the surfaces face that are seen from it.

    They count by the solid angle under which they are seen.
    """
    if solid.is_empty:
        return None
    ways = middle - solid.triangles_center
    distances = np.linalg.norm(ways, axis=1)
    facing = np.einsum("ij,ij->i", solid.face_normals, ways)
    seen = (facing > 0.0) & (distances > 1e-6)
    angles = solid.area_faces[seen] * facing[seen] / distances[seen] ** 3
    out = angles @ solid.face_normals[seen]
    out -= (out @ y) * y
    length = float(np.linalg.norm(out))
    return out / length if length > 1e-6 * angles.sum() and length > 0.0 else None


def _let_go(out: Array | None, y: Array, going: Going) -> Array | None:
    """The direction (3,) across a bar in which its joint lets it go; None for along the bar.

    It is `out` for a bar that goes nowhere, and has its sense for one that goes both ways.
    """
    across, both = going.way - (going.way @ y) * y, going.both
    length = float(np.linalg.norm(across))
    if not np.any(going.way):
        return out
    if length <= _ACROSS or (both and out is None):
        return None
    return np.asarray(
        across / (-length if both and out is not None and out @ across < 0.0 else length)
    )


def _free(
    x: Array, middle: Array, y: Array, radius: float, around: trimesh.Trimesh, turns: int = 4
) -> Array | None:
    """The direction (3,) across a bar next to `x` from which a hand gets to it; None for none."""
    points = np.zeros((0, 3))
    if not around.is_empty:
        points = np.asarray(trimesh.sample.sample_surface(around, _SAMPLES, seed=0)[0]) - middle
    z = np.cross(x, y)
    for turn in sorted(np.arange(-turns, turns + 1) * _TURN, key=abs):
        ahead = np.cos(turn) * x + np.sin(turn) * z
        aside = np.cross(ahead, y)
        forward = points @ ahead
        met = (forward > radius + 0.005) & (forward < _AHEAD)
        met &= (np.abs(points @ y) < _HAND) & (np.abs(points @ aside) < _HAND)
        if not met.any():
            return np.asarray(ahead)
    return None
