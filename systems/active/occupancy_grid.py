"""What of the space around an object has been seen: an occupancy grid, and what a view would show.

Each cell has the log odds of being occupied. A ray lowers those of the cells that it passes and
raises those of the cell in which it ends. Cells are found by going from border to border along the
ray (J. Amanatides and A. Woo, A fast voxel traversal algorithm for ray tracing, 1987).
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot

HIT, MISS = float(np.log(0.7 / 0.3)), float(np.log(0.4 / 0.6))  # Changes of the log odds.
FRAMES = 5  # Images of a view.
LEAST, LARGEST = float(np.log(0.12 / 0.88)), float(np.log(0.97 / 0.03))  # Of the log odds.


class OccupancyGrid(NamedTuple):
    """A cube of cells.

    Attributes:
        log_odds: Of being occupied (N, N, N); zero where nothing is known.
        corner: Least coordinates of the cube (3,), in W, [m].
        cell: Edge of a cell, [m].
    """

    log_odds: Array
    corner: Array
    cell: float


def empty_grid(centre: Array, half: float, cell: float) -> OccupancyGrid:
    """A grid of which nothing is known: a cube about `centre` (3,) with half an edge of `half`."""
    count = max(1, int(np.ceil(2.0 * half / cell)))
    return OccupancyGrid(
        log_odds=np.zeros((count, count, count)),
        corner=np.asarray(centre, dtype=float) - 0.5 * count * cell,
        cell=cell,
    )


@hot
def _enter(p: Array, d: Array, grid: OccupancyGrid) -> tuple[float, float]:
    """Distances along the ray p + s d between which it is inside the grid; none if they cross."""
    first, last = 0.0, np.inf
    for axis in range(3):
        low = grid.corner[axis]
        high = low + grid.cell * grid.log_odds.shape[axis]
        if abs(d[axis]) < 1e-12:
            if p[axis] < low or p[axis] >= high:
                return 1.0, 0.0
            continue
        a, b = (low - p[axis]) / d[axis], (high - p[axis]) / d[axis]
        first, last = max(first, min(a, b)), min(last, max(a, b))
    return first, last


@hot
def _first_cell(
    p: Array, d: Array, first: float, grid: OccupancyGrid, axis: int
) -> tuple[int, int, float, float]:
    """Along an axis: the ray's first cell, its step, and where and how often it meets a border."""
    at = (p[axis] + (first + 1e-9) * d[axis] - grid.corner[axis]) / grid.cell
    index = min(max(int(np.floor(at)), 0), grid.log_odds.shape[axis] - 1)
    step = 1 if d[axis] > 0.0 else -1
    if abs(d[axis]) <= 1e-12:
        return index, step, np.inf, np.inf
    edge = grid.corner[axis] + grid.cell * (index + (1 if d[axis] > 0.0 else 0))
    return index, step, (edge - p[axis]) / d[axis], grid.cell / abs(d[axis])


@hot
def cells_along(p: Array, d: Array, reach: float, grid: OccupancyGrid, cells: Array) -> int:
    """Writes the cells (M, 3) that a ray passes into `cells`, in order; their number.

    Args:
        p: Where it starts (3,), in W, [m].
        d: Its direction (3,), a unit vector.
        reach: Its length, [m].
        grid: The cells.
        cells: At least three times as many as the grid has along an edge.
    """
    first, last = _enter(p, d, grid)
    last = min(last, reach)
    if first >= last:
        return 0
    i, step_i, border_i, apart_i = _first_cell(p, d, first, grid, 0)
    j, step_j, border_j, apart_j = _first_cell(p, d, first, grid, 1)
    k, step_k, border_k, apart_k = _first_cell(p, d, first, grid, 2)
    along_i, along_j, along_k = grid.log_odds.shape
    count = 0
    while True:
        cells[count, 0], cells[count, 1], cells[count, 2] = i, j, k
        count += 1
        if min(border_i, border_j, border_k) >= last:
            return count
        if border_i <= border_j and border_i <= border_k:
            i, border_i = i + step_i, border_i + apart_i
            if i < 0 or i >= along_i:
                return count
        elif border_j <= border_k:
            j, border_j = j + step_j, border_j + apart_j
            if j < 0 or j >= along_j:
                return count
        else:
            k, border_k = k + step_k, border_k + apart_k
            if k < 0 or k >= along_k:
                return count


@hot
def _insert(eye: Array, directions: Array, reach: Array, ends: Mask, grid: OccupancyGrid) -> None:
    odds = grid.log_odds
    size = odds.shape[0] + odds.shape[1] + odds.shape[2] + 3
    cells = np.empty((size, 3), np.int64)
    change = np.zeros(odds.shape)
    for ray in range(len(directions)):
        count = cells_along(eye, directions[ray], reach[ray], grid, cells)
        for n in range(count):
            i, j, k = cells[n]
            if change[i, j, k] <= 0.0:
                change[i, j, k] = MISS
        if ends[ray]:
            at = np.floor((eye + reach[ray] * directions[ray] - grid.corner) / grid.cell)
            i, j, k = int(at[0]), int(at[1]), int(at[2])
            if 0 <= i < odds.shape[0] and 0 <= j < odds.shape[1] and 0 <= k < odds.shape[2]:
                change[i, j, k] = HIT
    for i in range(odds.shape[0]):
        for j in range(odds.shape[1]):
            for k in range(odds.shape[2]):
                odds[i, j, k] = min(max(odds[i, j, k] + change[i, j, k], LEAST), LARGEST)


def with_view(
    grid: OccupancyGrid, eye: Array, points: Array, passed: Array, frames: int = FRAMES
) -> OccupancyGrid:
    """The grid after a view.

    A camera that stands still takes many images, whose noise differs; one update alone would leave
    what was seen so doubtful that a neighbouring view seemed to be worth most.

    Args:
        grid: Before it; not changed.
        eye: Where the camera is (3,), in W, [m].
        points: That it sees (N, 3), in W.
        passed: Directions (B, 3) of rays that met nothing.
        frames: Images of the view.
    """
    seen = points - eye
    distances = np.linalg.norm(seen, axis=1)
    directions = np.concatenate([seen / distances[:, None], passed])
    reach = np.concatenate([distances, np.full(len(passed), 1e3)])
    ends = np.arange(len(directions)) < len(points)
    after = grid._replace(log_odds=grid.log_odds.copy())
    for _ in range(frames):
        _insert(np.ascontiguousarray(eye), np.ascontiguousarray(directions), reach, ends, after)
    return after


def entropy(log_odds: Array) -> Array:
    """Entropy of cells with these log odds, [bit]."""
    p = 1.0 / (1.0 + np.exp(-np.asarray(log_odds, dtype=float)))
    return np.asarray(-(p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p)))


def expected_fall(log_odds: Array, frames: int = FRAMES) -> Array:
    """By how much the entropy of cells is expected to fall if they are seen in a view, [bit].

    All images of a view say the same. What is known to be free hardly teaches anything more.
    """
    p = 1.0 / (1.0 + np.exp(-np.asarray(log_odds, dtype=float)))
    hit, miss = (np.clip(log_odds + frames * change, LEAST, LARGEST) for change in (HIT, MISS))
    after = p * entropy(hit) + (1.0 - p) * entropy(miss)
    return np.maximum(entropy(log_odds) - after, 0.0)


@hot
def _gains(X_WC: Array, rays: Array, reach: float, grid: OccupancyGrid, H: Array) -> Array:
    odds = grid.log_odds
    size = odds.shape[0] + odds.shape[1] + odds.shape[2] + 3
    cells = np.empty((size, 3), np.int64)
    seen, free = np.zeros(odds.shape), np.empty(odds.shape)
    for i in range(odds.shape[0]):
        for j in range(odds.shape[1]):
            for k in range(odds.shape[2]):
                free[i, j, k] = 1.0 / (1.0 + np.exp(odds[i, j, k]))
    gains = np.zeros(len(X_WC))
    d = np.empty(3)
    for view in range(len(X_WC)):
        seen[:] = 0.0
        eye = np.ascontiguousarray(X_WC[view, :3, 3])
        for ray in range(len(rays)):
            for i in range(3):
                d[i] = 0.0
                for j in range(3):
                    d[i] += X_WC[view, i, j] * rays[ray, j]
            count = cells_along(eye, d, reach, grid, cells)
            clear = 1.0
            for n in range(count):
                i, j, k = cells[n]
                if clear > seen[i, j, k]:
                    gains[view] += (clear - seen[i, j, k]) * H[i, j, k]
                    seen[i, j, k] = clear
                clear *= free[i, j, k]
                if clear < 0.02:
                    break
    return gains


def expected_gains(grid: OccupancyGrid, X_WC: Array, rays: Array, reach: float = 10.0) -> Array:
    """By how much views (V,) are expected to lower the entropy of the cells, [bit].

    A cell is seen as far as the cells before it are free.

    Args:
        grid: What is known.
        X_WC: Cameras (V, 4, 4).
        rays: Unit vectors (R, 3) in C.
        reach: Of the camera, [m].
    """
    return np.asarray(
        _gains(
            np.ascontiguousarray(X_WC),
            np.ascontiguousarray(rays),
            reach,
            grid,
            expected_fall(grid.log_odds),
        )
    )
