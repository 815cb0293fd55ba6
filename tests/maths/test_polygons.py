"""Polygons against closed forms, SciPy's hulls and dense grids of points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from crossmodal.maths.arrays import Array
from crossmodal.maths.polygons import (
    area,
    centroid,
    clipped,
    contains,
    convex_hull,
    distance,
    intersection_over_union,
    smallest_box,
)

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
# An L of three unit squares: its notch is the upper right one.
ELL = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])


def turned(points: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def moved(points: Array, x: float, y: float) -> Array:
    return points + np.array([x, y])


def star(rng: np.random.Generator) -> Array:
    """A polygon with notches around a random place."""
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 12))
    radii = rng.uniform(0.2, 1.0, 12)
    points = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.asarray(points + rng.uniform(-0.8, 0.8, 2))


def test_area_and_centroid_are_those_of_the_parts() -> None:
    assert area(ELL) == pytest.approx(3.0)
    assert area(ELL[::-1]) == pytest.approx(3.0)
    assert_allclose(centroid(ELL), [5.0 / 6.0, 5.0 / 6.0])
    assert_allclose(centroid(ELL[::-1] + 7.0), np.full(2, 7.0 + 5.0 / 6.0))
    assert area(np.zeros((0, 2))) == 0.0


def test_the_centroid_of_a_line_is_the_mean_of_its_ends() -> None:
    assert_allclose(centroid(np.array([[0.0, 0.0], [1.0, 2.0]])), [0.5, 1.0])
    assert_allclose(centroid(np.array([[3.0, 4.0]])), [3.0, 4.0])


@pytest.mark.parametrize("seed", range(10))
def test_the_hull_is_that_of_scipy(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(30, 2)) + 5.0
    hull, expected = convex_hull(points), ConvexHull(points)
    assert area(hull) == pytest.approx(expected.volume)
    assert {tuple(p) for p in hull} == {tuple(p) for p in points[expected.vertices]}
    edges = np.roll(hull, -1, axis=0) - hull
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    assert (turns > 0.0).all()  # Counter-clockwise.


@pytest.mark.parametrize("points", [[[1.0, 2.0]], [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]])
def test_points_on_a_line_have_a_box_without_area(points: list[list[float]]) -> None:
    box = smallest_box(np.array(points))
    assert box.shape == (4, 2)
    assert area(box) == pytest.approx(0.0, abs=1e-12)
    assert_allclose(box.mean(axis=0), np.mean(points, axis=0))


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0, np.pi / 4.0, -2.0])
def test_the_box_of_a_turned_rectangle_is_the_rectangle(angle: float) -> None:
    rectangle = moved(turned(SQUARE * [3.0, 1.0], angle), 0.4, -7.0)
    box = smallest_box(rectangle)
    for corner in rectangle:
        assert np.linalg.norm(box - corner, axis=1).min() < 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_no_turned_box_is_smaller(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(20, 2))
    box = smallest_box(points)
    assert contains(1.000001 * (box - box.mean(axis=0)) + box.mean(axis=0), points).all()
    areas = [np.prod(np.ptp(turned(points, a), axis=0)) for a in np.linspace(0, np.pi / 2, 5000)]
    assert area(box) <= min(areas) + 1e-12
    assert area(box) == pytest.approx(min(areas), rel=1e-3)


def test_what_is_common_to_rectangles_has_its_closed_form() -> None:
    assert area(clipped(SQUARE, moved(SQUARE, 0.25, 0.5))) == pytest.approx(0.75 * 0.5)
    assert intersection_over_union(SQUARE, moved(SQUARE, 0.5, 0.0)) == pytest.approx(1.0 / 3.0)
    assert intersection_over_union(SQUARE, SQUARE) == pytest.approx(1.0)
    assert intersection_over_union(SQUARE, moved(SQUARE, 3.0, 0.0)) == 0.0
    assert intersection_over_union(SQUARE, moved(SQUARE, 1.0, 0.0)) == 0.0
    # A square and itself turned by 45 degrees have a regular octagon in common.
    diamond = turned(SQUARE - 0.5, np.pi / 4.0) + 0.5
    octagon = 2.0 * (np.sqrt(2.0) - 1.0)
    assert area(clipped(SQUARE, diamond)) == pytest.approx(octagon)
    assert intersection_over_union(SQUARE, diamond) == pytest.approx(octagon / (2.0 - octagon))


def test_what_is_cut_into_parts_keeps_its_area() -> None:
    band = np.array([[1.2, -1.0], [3.0, -1.0], [3.0, 3.0], [1.2, 3.0]])
    assert area(clipped(ELL, band)) == pytest.approx(0.8)
    diagonal = np.array([[1.5, 3.0], [-1.0, 0.5], [0.5, -1.0], [3.0, 1.5]])[::-1]
    grid = np.stack(np.meshgrid(*2 * [np.arange(-1.0, 3.0, 0.004) + 0.002]), axis=-1)
    both = contains(ELL, grid) & contains(diagonal, grid)
    assert area(clipped(ELL, diagonal)) == pytest.approx(both.sum() * 0.004**2, rel=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_overlaps_of_polygons_with_notches_are_those_of_a_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon, box = star(rng), smallest_box(star(rng))
    grid = np.stack(np.meshgrid(*2 * [np.arange(-2.5, 2.5, 0.005)]), axis=-1)
    one, other = contains(polygon, grid), contains(box, grid)
    expected = (one & other).sum() / (one | other).sum()
    assert intersection_over_union(polygon, box) == pytest.approx(expected, abs=3e-3)


def test_distances_have_their_closed_forms() -> None:
    assert distance(SQUARE, moved(SQUARE, 1.5, 0.0)) == pytest.approx(0.5)
    assert distance(SQUARE, moved(SQUARE, 4.0, 5.0)) == pytest.approx(5.0)
    assert distance(SQUARE, moved(SQUARE, 1.0, 0.3)) == pytest.approx(0.0, abs=1e-15)
    assert distance(SQUARE, SQUARE) == 0.0
    assert distance(SQUARE, 0.1 * SQUARE + 0.4) == 0.0  # Within it.
    assert distance(0.1 * SQUARE + 0.4, SQUARE) == 0.0
    assert distance(0.2 * SQUARE + 1.5, ELL) == pytest.approx(0.5)  # In its notch.
    cross = (SQUARE - 0.5) * [4.0, 0.2]
    assert distance(cross, cross[:, ::-1]) == 0.0  # No corner lies in the other one.


@pytest.mark.parametrize("seed", range(10))
def test_distances_are_those_of_densely_sampled_edges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = star(rng), moved(star(rng), rng.uniform(1.0, 2.5), 0.0)
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    a, b = (((1.0 - share) * p + share * np.roll(p, -1, axis=0)).reshape(-1, 2)
            for p in (first, second))  # fmt: skip
    least = np.linalg.norm(a[:, None] - b[None], axis=-1).min()
    overlap = contains(first, b).any() or contains(second, a).any()
    assert distance(first, second) == pytest.approx(0.0 if overlap else least, abs=5e-3)
