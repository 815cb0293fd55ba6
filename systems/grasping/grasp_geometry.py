"""Grasps straight from above by two parallel fingers: their height, and what is in their way.

A grasp is a row (x, y, angle, width, z): of the gripper's frame E the place in W [m] and the angle
of x, along the opening, about z of W [rad]; the width between the fingers before they close [m];
the height of their ends above the table [m].
"""

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.models.gripper_taxels import PALM, PALM_ABOVE, THICKNESS, TRAVEL, WIDTH
from crossmodal.systems.grasping.height_map import CELL, CELLS, HeightMap, highest_within

STROKE = 2.0 * TRAVEL  # Widest opening, [m].
MARGIN = 0.008  # Between object and fingers on each side before they close, [m].

# Least height of the fingers' ends above the table, on which they come down softly; their inner
# taxels are 8 mm higher, about where a pen that lies is widest, [m].
_LOWEST = 0.001
_DEEPEST = 0.045  # So far the fingers reach down beside an object, [m]: the inner taxels and more.
_BETWEEN = 15  # Points along each edge of what is between the fingers.
_PALM_STEP = 0.005  # Between points of the palm that are looked at, [m].


def fingertip_height(top: Array) -> Array:
    """Height of the fingers' ends above the table for heights of the object there, [m]."""
    return np.maximum(_LOWEST, top - _DEEPEST)


def tops(heights: Array, grasps: Array, view: HeightMap) -> Array:
    """Greatest height (N,) of an object within half a finger's width of grasps' places, [m].

    Args:
        heights: Of the object on the cells of the map, [m].
        grasps: (N, 3) or more columns.
        view: Where the cells are.
    """
    columns, rows = np.clip(np.round(view.cells(grasps[:, :2])), 0, CELLS - 1).astype(int).T
    return np.asarray(highest_within(heights)[rows, columns])


def levers(heights: Array, grasps: Array, view: HeightMap) -> Array:
    """How far (N,) from what fingers hold between them an object's weight pulls to a side, [m].

    The object is taken to be as heavy everywhere as it is high. Along the opening that does not
    matter: both fingers bear it.

    Args:
        heights: Of the object on the cells of the map, at least one above zero, [m].
        grasps: (N, 3) or more columns.
        view: Where the cells are.
    """
    rows, columns = np.nonzero(heights > 0.0)
    places = view.places(np.column_stack([columns, rows]))
    away = np.average(places, axis=0, weights=heights[rows, columns]) - grasps[:, :2]
    return np.abs(away[:, 1] * np.cos(grasps[:, 2]) - away[:, 0] * np.sin(grasps[:, 2]))


def highest_under_fingers(
    heights: Array, grasps: Array, view: HeightMap, around: float = 0.0
) -> Array:
    """Greatest height (N,) onto which the fingers would come down, [m].

    Args:
        heights: On the cells of the map, [m].
        grasps: (N, 4) or more columns.
        view: Where the cells are.
        around: By so much the fingers are taken to be larger on each side, [m].
    """
    across = 0.5 * WIDTH + around
    x, y = _grid((-around, THICKNESS + around), (-across, across), CELL)
    x = 0.5 * grasps[:, 3, None] + x
    return np.maximum(*(_highest(heights, grasps, side * x, y, view) for side in (-1.0, 1.0)))


def highest_between_fingers(heights: Array, grasps: Array, view: HeightMap) -> Array:
    """Greatest height (N,) between the fingers before they close, [m].

    Args:
        heights: On the cells of the map, [m].
        grasps: (N, 4) or more columns.
        view: Where the cells are.
    """
    across = np.linspace(-0.5, 0.5, _BETWEEN)
    x, y = (k.ravel() for k in np.meshgrid(across, WIDTH * across))
    return _highest(heights, grasps, grasps[:, 3, None] * x, y, view)


def highest_under_palm(heights: Array, grasps: Array, view: HeightMap) -> Array:
    """Greatest height (N,) below the palm, [m], whatever the opening; see above."""
    half_x, half_y = 0.5 * PALM[0], 0.5 * PALM[1]
    x, y = _grid((-half_x, half_x), (-half_y, half_y), _PALM_STEP)
    return _highest(heights, grasps, x, y, view)


def is_blocked(heights: Array, grasps: Array, view: HeightMap) -> Mask:
    """Whether fingers (N,) would come down on something, or the palm; see above."""
    under, palm = (of(heights, grasps, view) for of in (highest_under_fingers, highest_under_palm))
    z = grasps[:, 4]
    return np.asarray((under > z) | (palm > z + PALM_ABOVE))


def _grid(x: tuple[float, float], y: tuple[float, float], step: float) -> tuple[Array, Array]:
    """x and y (P,) of points between ends along both axes, the step or less apart."""
    lines = [np.linspace(a, b, int(np.ceil((b - a) / step)) + 1) for a, b in (x, y)]
    xx, yy = np.meshgrid(*lines)
    return xx.ravel(), yy.ravel()


def _highest(heights: Array, grasps: Array, x: Array, y: Array, view: HeightMap) -> Array:
    """Greatest height (N,) at points (N, P) or (P,) in x and y of each grasp; zero outside."""
    c, s = np.cos(grasps[:, 2, None]), np.sin(grasps[:, 2, None])
    xy = grasps[:, None, :2] + np.stack([c * x - s * y, s * x + c * y], axis=-1)
    columns, rows = np.moveaxis(np.round(view.cells(xy)).astype(int), -1, 0)
    inside = (columns >= 0) & (columns < heights.shape[1]) & (rows >= 0) & (rows < heights.shape[0])
    found = heights[np.where(inside, rows, 0), np.where(inside, columns, 0)]
    return np.asarray(np.where(inside, found, 0.0).max(axis=1))
