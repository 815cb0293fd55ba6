"""Draws into Meshcat from where an object could be looked at and touched, and what is chosen."""

import numpy as np
import trimesh
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.meshcat import Shown, frame_along, rigid_transform
from crossmodal.maths.arrays import Array, Ids
from crossmodal.systems.active.occupancy_grid import OccupancyGrid
from crossmodal.systems.active.view_planner import NO_GRID
from crossmodal.systems.port_values import NO_TOUCH, NO_VIEW, TouchRequest, ViewRequest

GRID, MUCH = "#CCBB44", "#AA3377"  # Occupied cells; a candidate that would teach much,
_LITTLE = "#AAAAAA"  # and one that would teach little.
_OCCUPIED = float(np.log(0.6 / 0.4))  # Log odds of a cell that is drawn.
_FRUSTUM, _CHOSEN_FRUSTUM = 0.018, 0.06  # Lengths of a camera, [m].
_ARROW = 0.02  # Length of a candidate touch, [m].


class Views:
    """The occupancy grid, and from where the object could be looked at next."""

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat, self._path = meshcat, path
        self._request, self._grid, self._grids = NO_VIEW, NO_GRID, 0
        self._candidates, self._cells = Shown(meshcat), Shown(meshcat)
        vertices, faces = _frustum(_CHOSEN_FRUSTUM)
        color = Rgba(*palette.rgb(palette.PLAN))
        meshcat.SetTriangleMesh(f"{path}/chosen", *as_mesh(vertices, faces), color)
        meshcat.SetProperty(f"{path}/chosen", "visible", False)
        self._chosen = Shown(meshcat)

    def draw(self, time: float, request: ViewRequest, grid: OccupancyGrid, over: bool) -> None:
        """Draws what is new; `over`: no more views are wanted."""
        if over:
            for shown in (self._candidates, self._chosen, self._cells):
                shown.hide(time)
            return
        if grid is not self._grid:
            self._grid, self._grids = grid, self._grids + 1
            self._draw_grid(time, grid)
        if request.number > self._request.number:
            self._request = request
            self._draw_request(time, request)

    def _draw_grid(self, time: float, grid: OccupancyGrid) -> None:
        cells = np.argwhere(grid.log_odds > _OCCUPIED)
        if len(cells) == 0:
            self._cells.hide(time)
            return
        path = f"{self._path}/grid/{self._grids}"
        half = 0.22 * grid.cell
        at = grid.corner + grid.cell * (cells + 0.5)
        cube = trimesh.creation.box(extents=3 * [2.0 * half])
        vertices, faces = _copies(np.asarray(cube.vertices), np.asarray(cube.faces), at)
        self._meshcat.SetTriangleMesh(path, *as_mesh(vertices, faces), Rgba(*palette.rgb(GRID)))
        self._cells.show(path, time)

    def _draw_request(self, time: float, request: ViewRequest) -> None:
        if len(request.candidates):
            path = f"{self._path}/candidates/{request.number}"
            small, faces = _frustum(_FRUSTUM)
            R, p = request.candidates[:, :3, :3], request.candidates[:, :3, 3]
            vertices = small @ np.swapaxes(R, 1, 2) + p[:, None]
            _set_coloured(self._meshcat, path, vertices, faces, request.gains)
            self._candidates.show(path, time)
        chosen = f"{self._path}/chosen"
        self._meshcat.SetTransform(chosen, rigid_transform(request.X_WC), time)
        self._chosen.show(chosen, time)


class Touches:
    """Where the object could be touched next, and where it will be."""

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat, self._path = meshcat, path
        self._request = NO_TOUCH
        self._candidates = Shown(meshcat)
        color = Rgba(*palette.rgb(palette.PLAN))
        chosen = f"{path}/chosen"
        meshcat.SetObject(f"{chosen}/bar/rod", Cylinder(0.003, 1.0), color)
        meshcat.SetObject(f"{chosen}/tip/cone", MeshcatCone(0.025, 0.009, 0.009), color)
        # Meshcat's cone stands on its tip; this one points along the approach.
        turned = RigidTransform(RotationMatrix.MakeXRotation(np.pi))
        meshcat.SetTransform(f"{chosen}/tip/cone", turned)
        meshcat.SetObject(f"{chosen}/expected", Sphere(0.009), color)
        meshcat.SetProperty(chosen, "visible", False)
        self._chosen = Shown(meshcat)

    def draw(self, time: float, request: TouchRequest) -> None:
        if request.done and not self._request.done:
            self._request = request
            self._candidates.hide(time)
            self._chosen.hide(time)
        if request.done or request.number <= self._request.number:
            return
        self._request = request
        if len(request.candidates):
            path = f"{self._path}/candidates/{request.number}"
            cone = trimesh.creation.cone(0.25 * _ARROW, _ARROW, sections=8)
            starts, directions = request.candidates[:, 0], request.candidates[:, 1]
            R = np.array([frame_along(d).matrix() for d in directions])
            vertices = np.asarray(cone.vertices) @ np.swapaxes(R, 1, 2) + starts[:, None]
            faces = np.asarray(cone.faces)
            _set_coloured(self._meshcat, path, vertices, faces, request.gains)
            self._candidates.show(path, time)
        self._draw_chosen(time, request)

    def _draw_chosen(self, time: float, request: TouchRequest) -> None:
        chosen, d = f"{self._path}/chosen", request.direction
        R_WA = frame_along(d)
        for part, along in (
            ("bar", 0.5 * request.reach),
            ("tip", request.reach),
            ("expected", request.expected),
        ):
            X_WA = RigidTransform(R_WA, request.start + along * d)
            self._meshcat.SetTransform(f"{chosen}/{part}", X_WA, time)
        length = max(request.reach, 1e-4)
        self._meshcat.SetProperty(f"{chosen}/bar/rod", "scale", [1.0, 1.0, length], time)
        self._chosen.show(chosen, time)


def _frustum(length: float) -> tuple[Array, Ids]:
    """A camera's pyramid: vertices (5, 3) in C, its tip at C's origin, [m]; triangles (6, 3)."""
    x, y = 0.55 * length, 0.4 * length
    corners = [(-x, -y, length), (x, -y, length), (x, y, length), (-x, y, length)]
    sides = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 1, 4), (1, 2, 3), (1, 3, 4)]
    pyramid = trimesh.Trimesh([(0.0, 0.0, 0.0), *corners], sides, process=False)
    pyramid.fix_normals()
    return np.asarray(pyramid.vertices), np.asarray(pyramid.faces)


def _copies(vertices: Array, faces: Ids, at: Array) -> tuple[Array, Ids]:
    """One mesh of a body (V, 3), (T, 3) at many places (N, 3)."""
    return _joined(vertices + at[:, None], faces)


def _joined(vertices: Array, faces: Ids) -> tuple[Array, Ids]:
    """One mesh of bodies (N, V, 3) that have the same triangles (T, 3)."""
    count, size = vertices.shape[:2]
    numbers = size * np.arange(count)[:, None, None] + faces
    return vertices.reshape(-1, 3), numbers.reshape(-1, 3)


def as_mesh(vertices: Array, faces: Ids) -> tuple[Array, Ids]:
    """As Meshcat wants it: (3, V) and (3, T)."""
    return np.asfortranarray(vertices.T, dtype=float), np.asfortranarray(faces.T.astype(np.int32))


def _set_coloured(meshcat: Meshcat, path: str, vertices: Array, faces: Ids, gains: Array) -> None:
    """Draws bodies (N, V, 3) in colours by their gains (N,), the largest one fully coloured."""
    low, high = float(gains.min()), float(gains.max())
    share = (gains - low) / max(high - low, 1e-12)
    little, much = np.array(palette.rgb(_LITTLE)), np.array(palette.rgb(MUCH))
    colors = little + share[:, None] * (much - little)
    of_vertices = np.repeat(colors, vertices.shape[1], axis=0)
    meshcat.SetTriangleColorMesh(
        path, *as_mesh(*_joined(vertices, faces)), np.asfortranarray(of_vertices.T)
    )
