"""How far an object has been moved between two images, by its outlines."""

import cv2
import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import Segment

_CELL = 0.003  # Edge of the cells by which outlines are compared, [m].
_TURNS = 24  # Directions in which an object may lie afterwards, over a full turn.
_ALIKE = 0.04  # Share of an outline by which motions may explain it worse than the best one.


def displacement(before: Segment, after: Segment) -> float:
    """The least motion [m] that explains two outlines of an object on the table.

    An image may show more or less of an object that rests, and the rim of a mask flickers. So the
    motion is sought, a turn and a translation, that lays the one outline over the other as far as
    that is possible; of all that do so about as well it is the smallest. Its size is the root mean
    square of the way of the outline's area. What one image hides of an object tells nothing, so
    that this may be less than the truth.
    """
    was, now = _points(before), _points(after)
    smaller = min(len(was), len(now))
    here = float(shapely.intersection(before.contour, after.contour).area) / _CELL**2
    if here >= (1.0 - _ALIKE) * smaller:
        return 0.0
    middle = was.mean(axis=0)
    radius = float(np.sqrt(np.square(was - middle).sum(axis=1).mean()))
    least = now.min(axis=0)
    seen = _image(now - least)
    turns = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    overlaps, sizes = [here], [0.0]
    for turn in np.where(turns > np.pi, turns - 2.0 * np.pi, turns):
        c, s = np.cos(turn), np.sin(turn)
        turned = (was - middle) @ np.array([[c, s], [-s, c]])
        low = turned.min(axis=0)
        shape = _image(turned - low)
        # Placed with its first cell so many cells before or behind that of the other one.
        rows, columns = shape.shape
        padded = np.pad(seen, ((rows - 1, rows - 1), (columns - 1, columns - 1)))
        overlap = cv2.matchTemplate(padded, shape, cv2.TM_CCORR)
        y, x = np.indices(overlap.shape)
        places = np.stack([x - (columns - 1), y - (rows - 1)], axis=-1) * _CELL
        ways = least + places - low - middle
        overlaps.append(overlap.ravel())
        sizes.append(np.hypot(np.linalg.norm(ways, axis=-1), radius * turn).ravel())
    every, size = np.hstack(overlaps), np.hstack(sizes)
    return float(size[every >= every.max() - _ALIKE * smaller].min())


def _points(segment: Segment) -> Array:
    """Middles (N, 2) of the cells within an outline, [m]; at least one."""
    left, bottom, right, top = segment.contour.bounds
    x, y = np.meshgrid(
        np.arange(left, right, _CELL) + 0.5 * _CELL, np.arange(bottom, top, _CELL) + 0.5 * _CELL
    )
    inside = shapely.contains_xy(segment.contour, x, y)
    if not inside.any():
        return np.asarray(segment.centroid[None])
    return np.column_stack([x[inside], y[inside]])


def _image(points: Array) -> Array:
    """The cells (rows, columns) in which points (N, 2) are, whose least coordinates are zero."""
    columns, rows = np.round(points / _CELL).astype(int).T
    image = np.zeros((rows.max() + 1, columns.max() + 1), np.float32)
    image[rows, columns] = 1.0
    # A turned grid leaves holes.
    return np.asarray(cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((3, 3))))
