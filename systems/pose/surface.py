"""An object's surface by samples: distances to it, their gradients, and rays that meet it."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot

_VOXELS = 400_000  # About so many divide the box around it.
_MARGIN = 0.15  # Of that box's diagonal on each side.
_BACK = -0.1  # Cosine to where a point was seen from, below which a side is the other one.
_NEIGHBOURS = 16  # Samples among which one of the right side is looked for.


class Surface(NamedTuple):
    """The surface of an object by samples, and for each place around it the nearest one.

    Distances are those to the plane of the nearest sample, so that they are exact on flat faces and
    right to second order on curved ones, however coarse the voxels are. Of a thin wall, or beside a
    sharp edge, samples of either side may be nearest: the one that counts sees the place from
    outside if it is outside.

    Attributes:
        points: Samples of the surface (N, 3), relative to the middle, [m].
        normals: Outwards (N, 3).
        nearest: For each voxel (X, Y, Z) the number of the sample that is nearest to its centre, of
            those on whose outer side it is if it is outside, and on whose inner side if inside.
        corner: Centre of the first voxel (3,), [m].
        voxel: Edge length, [m].
        spacing: Of the samples, [m]: none are nearer to each other, and hardly any place is farther
            from all of them.
    """

    points: Array
    normals: Array
    nearest: Ids
    corner: Array
    voxel: float
    spacing: float


def make_surface(points: Array, normals: Array, corners: Array, spacing: float) -> Surface:
    """The surface that samples describe.

    Args:
        points: Samples (N, 3), relative to the middle, [m].
        normals: Outwards (N, 3).
        corners: Of the closed surface's triangles (T, 3, 3), relative to the middle, [m].
        spacing: Of the samples, [m].
    """
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    corners = np.ascontiguousarray(corners)
    return Surface(points, normals, *_nearest_samples(points, normals, corners), spacing)


def _nearest_samples(points: Array, normals: Array, corners: Array) -> tuple[Ids, Array, float]:
    """`nearest`, `corner` and `voxel` of a surface of samples and triangles (T, 3, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * float(np.linalg.norm(high - low))
    low, high = low - margin, high + margin
    voxel = float(np.cbrt(np.prod(high - low) / _VOXELS))
    nx, ny, nz = (int(count) + 1 for count in np.ceil((high - low) / voxel))
    inside = _insides(corners, low, voxel, nx, ny, nz)
    centres = low + voxel * np.moveaxis(np.indices((nx, ny, nz)), 0, -1).reshape(-1, 3)
    _, near = cKDTree(points).query(centres, _NEIGHBOURS, workers=-1)
    nearest = _of_right_side(centres, inside.ravel(), near, points, normals)
    return nearest.reshape(inside.shape), low, voxel


@hot
def _of_right_side(centres: Array, inside: Mask, near: Ids, points: Array, normals: Array) -> Ids:
    """Of each centre's neighbours (V, K) the nearest one whose side agrees, or the nearest one."""
    found = np.empty(len(centres), np.int64)
    for n in range(len(centres)):
        found[n] = near[n, 0]
        for k in near[n]:
            height = 0.0
            for i in range(3):
                height += (centres[n, i] - points[k, i]) * normals[k, i]
            if (height < 0.0) == inside[n]:
                found[n] = k
                break
    return found


@hot
def _insides(corners: Array, low: Array, voxel: float, nx: int, ny: int, nz: int) -> Mask:
    """Which centres of voxels (X, Y, Z) are inside of a closed surface of triangles (T, 3, 3).

    Along each column of voxels the surface is entered and left again where it crosses the column.
    Columns pass a little beside the centres, so that they meet no edge.
    """
    turns = np.zeros((nx, ny, nz + 1), np.int32)
    beside = 1e-3 * voxel * np.array([np.sqrt(2.0), np.sqrt(3.0)])
    for triangle in corners:
        a, b, c = triangle[0], triangle[1], triangle[2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        first, last = np.empty(2, np.int64), np.empty(2, np.int64)
        for i in range(2):
            start = low[i] + beside[i]
            first[i] = int(np.ceil((min(a[i], b[i], c[i]) - start) / voxel))
            last[i] = int(np.floor((max(a[i], b[i], c[i]) - start) / voxel))
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                x = low[0] + beside[0] + i * voxel
                y = low[1] + beside[1] + j * voxel
                u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                if u < 0.0 or v < 0.0 or u + v > 1.0:
                    continue
                z = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
                k = min(max(int(np.ceil((z - low[2]) / voxel)), 0), nz)
                turns[i, j, k] += 1 if area < 0.0 else -1  # Upwards it is entered from below.
    inside = np.empty((nx, ny, nz), np.bool_)
    for i in range(nx):
        for j in range(ny):
            winding = 0
            for k in range(nz):
                winding += turns[i, j, k]
                inside[i, j, k] = winding > 0
    return inside


@hot
def _beside(surface: Surface) -> float:
    """How far the nearest sample may lie beside a point on its face: by voxel and spacing, [m]."""
    return float(0.9 * surface.voxel + 1.2 * surface.spacing)


@hot
def surface_distance(
    p: Array,
    facing: Array,
    surface: Surface,
    m: Array,
) -> float:
    """Signed distance of a point to the surface, and its gradient, written into `m` (3,).

    It is that to the plane of the nearest sample; to the sample itself where the point lies beyond
    the edge of a face. Of a thin wall, the side counts that faces where the point was seen from.

    Args:
        p: (3,), relative to the middle.
        facing: Unit vector (3,) in O, or zero if any side will do.
        surface: Of the object.

    Returns:
        The distance, [m]; infinite where no side near the point faces there.
    """
    points, normals = surface.points, surface.normals
    k = nearest_sample(p, surface)
    height, towards = 0.0, 0.0
    for i in range(3):
        height += (p[i] - points[k, i]) * normals[k, i]
        towards += facing[i] * normals[k, i]
    # A voxel's centre may be inside of a thin wall or behind it, and the point before it.
    if towards < _BACK or (towards == 0.0 and height < 0.0):
        k = nearest_of_eight(p, facing, surface)
        if k < 0:
            return np.inf
    height, square = 0.0, 0.0
    for i in range(3):
        m[i] = p[i] - points[k, i]
        height += m[i] * normals[k, i]
        square += m[i] * m[i]
    if square - height * height <= _beside(surface) ** 2:
        for i in range(3):
            m[i] = normals[k, i]
        return height
    distance = np.sqrt(square)
    # Beside an edge a point may lie a little below the plane of a face that ends there.
    sign = 1.0 if height > -0.5 * distance else -1.0
    for i in range(3):
        m[i] *= sign / distance
    return float(sign * distance)


@hot
def nearest_distances(p: Array, surface: Surface) -> Array:
    """Distances (N,) of points (N, 3), relative to the middle, to the surface nearby, exactly."""
    points, normals = surface.points, surface.normals
    found, nowhere = np.empty(len(p)), np.zeros(3)
    for n in range(len(p)):
        k = nearest_of_eight(p[n], nowhere, surface)
        height, square = 0.0, 0.0
        for i in range(3):
            apart = p[n, i] - points[k, i]
            height += apart * normals[k, i]
            square += apart * apart
        flat = square - height * height <= _beside(surface) ** 2
        found[n] = abs(height) if flat else np.sqrt(square)
    return found


@hot
def nearest_sample(p: Array, surface: Surface) -> int:
    """Number of the sample that is about nearest to a point `p` (3,) relative to the middle."""
    nearest, corner, voxel = surface.nearest, surface.corner, surface.voxel
    i = min(max(int(np.floor((p[0] - corner[0]) / voxel + 0.5)), 0), nearest.shape[0] - 1)
    j = min(max(int(np.floor((p[1] - corner[1]) / voxel + 0.5)), 0), nearest.shape[1] - 1)
    k = min(max(int(np.floor((p[2] - corner[2]) / voxel + 0.5)), 0), nearest.shape[2] - 1)
    return int(nearest[i, j, k])


@hot
def nearest_of_eight(
    p: Array,
    facing: Array,
    surface: Surface,
) -> int:
    """The best of the samples of the eight voxels around `p`: the nearest one, near the surface.

    Only those count that do not turn their back on `facing` (3,); -1 if all do.
    """
    points, normals, voxel = surface.points, surface.normals, surface.voxel
    best, found = np.inf, -1
    q = np.empty(3)
    for place in range(8):
        for axis in range(3):
            q[axis] = p[axis] + (0.5 if place >> axis & 1 else -0.5) * voxel
        k = nearest_sample(q, surface)
        square, towards = 0.0, 0.0
        for axis in range(3):
            square += (p[axis] - points[k, axis]) ** 2
            towards += facing[axis] * normals[k, axis]
        if square < best and towards >= _BACK:
            best, found = square, k
    return found


@hot
def cast_rays(
    starts: Array,
    directions: Array,
    reach: Array,
    surface: Surface,
    exact: bool,
) -> tuple[Array, Ids]:
    """Where rays from outside meet the surface.

    Args:
        starts: (R, 3), relative to the middle, [m].
        directions: Unit vectors (R, 3).
        reach: How far each goes (R,), [m].
        surface: Of the object.
        exact: Whether edges are where they are, at five times the time, or within a voxel.

    Returns:
        Distances (R,), infinite for a miss, and the sample (R,) met, -1 for a miss.
    """
    points, normals, voxel = surface.points, surface.normals, surface.voxel
    count, spacing = len(starts), surface.spacing
    across = 1.2 * spacing if exact else spacing + voxel
    step = spacing if exact else voxel
    found, samples = np.full(count, np.inf), np.full(count, -1)
    p, nowhere = np.empty(3), np.zeros(3)
    for ray in range(count):
        along = 0.0
        while along < reach[ray]:
            for axis in range(3):
                p[axis] = starts[ray, axis] + along * directions[ray, axis]
            k = nearest_sample(p, surface)
            square = 0.0
            for axis in range(3):
                square += (p[axis] - points[k, axis]) ** 2
            apart = np.sqrt(square)
            if apart > 3.0 * voxel:
                along += apart - 2.0 * voxel
                continue
            if exact:
                k = nearest_of_eight(p, nowhere, surface)
            square, height, slope = 0.0, 0.0, 0.0
            for axis in range(3):
                offset = p[axis] - points[k, axis]
                square += offset * offset
                height += offset * normals[k, axis]
                slope += directions[ray, axis] * normals[k, axis]
            if height < 0.5 * spacing and slope < 0.0:
                # Past the edge of a face its plane goes on, the samples do not.
                hit = along - height / min(slope, -0.05)
                square = 0.0
                for axis in range(3):
                    q = starts[ray, axis] + hit * directions[ray, axis] - points[k, axis]
                    square += q * q
                if square < across**2:
                    found[ray], samples[ray] = hit, k
                    break
            along += max(0.5 * (np.sqrt(square) - step), 0.25 * step)
    return found, samples
