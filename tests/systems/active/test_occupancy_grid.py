"""Ray traversal against brute force, and gains that fall on what was seen."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.active.occupancy_grid import (
    HIT,
    LARGEST,
    LEAST,
    MISS,
    OccupancyGrid,
    cells_along,
    empty_grid,
    entropy,
    expected_fall,
    expected_gains,
    with_view,
)


def traversed(p: np.ndarray, d: np.ndarray, reach: float, grid: OccupancyGrid) -> list[tuple]:
    cells = np.empty((4 * grid.log_odds.shape[0] + 3, 3), np.int64)
    return [tuple(cell) for cell in cells[: cells_along(p, d, reach, grid, cells)].tolist()]


def sampled(p: np.ndarray, d: np.ndarray, reach: float, grid: OccupancyGrid) -> set[tuple]:
    at = p + np.linspace(0.0, reach, 20001)[:, None] * d
    index = np.floor((at - grid.corner) / grid.cell).astype(int)
    inside = np.all((index >= 0) & (index < grid.log_odds.shape[0]), axis=1)
    return set(map(tuple, index[inside].tolist()))


@pytest.mark.parametrize("seed", range(20))
def test_a_ray_passes_the_cells_that_lie_on_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = empty_grid(np.array([0.5, 0.0, 0.1]), 0.15, 0.02)
    p = np.array([0.5, 0.0, 0.1]) + rng.uniform(-0.4, 0.4, 3)
    d = rng.normal(size=3) if seed else np.array([0.0, 1.0, 0.0])
    d /= np.linalg.norm(d)
    reach = rng.uniform(0.1, 1.0)
    found, expected = traversed(p, d, reach, grid), sampled(p, d, reach, grid)
    assert len(set(found)) == len(found)
    # Samples miss a cell of which only a corner is cut.
    assert expected <= set(found)
    assert len(found) <= len(expected) + 2
    steps = np.abs(np.diff(np.array(found).reshape(-1, 3), axis=0)).sum(axis=1)
    assert np.all(steps == 1)


def test_a_view_marks_what_it_hits_and_what_it_passes() -> None:
    grid = empty_grid(np.zeros(3), 0.1, 0.02)
    eye, point = np.array([-0.5, 0.01, 0.01]), np.array([[0.01, 0.01, 0.01]])
    seen = with_view(grid, eye, point, np.zeros((0, 3)), frames=1)
    assert seen.log_odds[5, 5, 5] == HIT
    assert_allclose(seen.log_odds[:5, 5, 5], MISS)
    assert_allclose(seen.log_odds[6:, 5, 5], 0.0)
    assert np.count_nonzero(seen.log_odds) == 6
    assert not grid.log_odds.any()
    often = with_view(grid, eye, point, np.zeros((0, 3)), frames=50)
    assert often.log_odds[5, 5, 5] == LARGEST
    assert_allclose(often.log_odds[:5, 5, 5], LEAST)


def test_entropy_is_largest_where_nothing_is_known() -> None:
    assert entropy(np.zeros(1))[0] == 1.0
    assert_allclose(entropy(np.array([HIT])), 0.8813, atol=1e-4)


def looking(azimuth: float, distance: float = 0.5) -> np.ndarray:
    X = np.eye(4)
    z = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    x = np.cross(z, [0.0, 0.0, 1.0])
    X[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X[:3, 3] = -distance * z
    return X


def fan() -> np.ndarray:
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 40), np.linspace(-0.3, 0.3, 40))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def seen_ball(grid: OccupancyGrid, azimuth: float) -> OccupancyGrid:
    """The grid after a view of a ball of 6 cm."""
    X, rays = looking(azimuth), fan()
    d = rays @ X[:3, :3].T
    along = -d @ X[:3, 3]
    apart = np.sum(X[:3, 3] ** 2) - along**2
    met = apart < 0.06**2
    points = X[:3, 3] + (along - np.sqrt(np.maximum(0.06**2 - apart, 0.0)))[met, None] * d[met]
    return with_view(grid, X[:3, 3], points, d[~met])


def test_the_gain_is_that_of_the_visible_cells() -> None:
    """Before anything is known, cells hide each other by half; a free grid is seen whole."""
    grid = empty_grid(np.zeros(3), 0.1, 0.02)
    doubtful = grid._replace(log_odds=np.full(grid.log_odds.shape, MISS))
    ray = np.array([[0.0, 0.0, 1.0]])
    X = looking(0.0)[None]
    X[0, :3, 3] += [0.0, 0.01, 0.01]
    unknown = expected_fall(np.zeros(1))
    assert_allclose(expected_gains(grid, X, ray), unknown * sum(0.5**n for n in range(6)))
    expected = expected_fall(np.array([MISS])) * sum(0.6**n for n in range(8))
    assert_allclose(expected_gains(doubtful, X, ray), expected, rtol=1e-6)


def test_what_is_known_to_be_free_teaches_nothing_more() -> None:
    falls = expected_fall(np.array([0.0, MISS, 2.0 * MISS, LEAST]))
    assert np.all(np.diff(falls) < 0.0)
    assert falls[0] > 0.5
    assert falls[-1] < 0.02


def test_the_next_view_is_from_another_side() -> None:
    grid = empty_grid(np.zeros(3), 0.1, 0.01)
    azimuths = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    views = np.array([looking(azimuth) for azimuth in azimuths])
    before = expected_gains(grid, views, fan())
    assert before.std() < 0.1 * before.mean()
    seen = seen_ball(grid, 0.0)
    after = expected_gains(seen, views, fan())
    same = np.argmin(np.abs(azimuths))
    assert after[same] < 0.5 * before[same]
    assert abs(azimuths[np.argmax(after)]) > np.deg2rad(90.0)
    both = seen_ball(seen, np.pi)
    assert expected_gains(both, views, fan()).max() < 0.5 * after.max()
