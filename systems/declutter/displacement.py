"""How far an object has been moved between two images, by its outlines."""

import cv2
import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import Segment

_CELL = 0.003  # Edge of the cells by which outlines are compared, [m].
_TURNS = 24  # Directions in which an object may lie afterwards, over a full turn.
_RIM = 0.006  # By which the bare table may be where an object is, since outlines err, [m].
_NOWHERE = shapely.Polygon()
_ALIKE = 0.04  # Share of an outline by which motions may explain it worse than the best one.


def displacement(before: Segment, after: Segment, bare: shapely.Geometry = _NOWHERE) -> float:
    """The least motion [m] that explains two outlines of an object on the table.

    An image may show more or less of an object that rests, and the rim of a mask flickers. So the
    motion is sought, a turn and a translation, that lays the one outline over the other as far as
    that is possible; of all that do so about as well it is the smallest. Its size is the root mean
    square of the way of the outline's area. What one image hides of an object tells nothing, so
    that this may be less than the truth.

    Args:
        before: The object in one image.
        after: In a later one.
        bare: Where the later one shows the table: the object is not there.
    """
    was, now = _points(before), _points(after)
    smaller = min(len(was), len(now))
    bare = bare.buffer(-_RIM)
    here = before.contour.intersection(after.contour).area - before.contour.intersection(bare).area
    here = float(here) / _CELL**2
    if here >= (1.0 - _ALIKE) * smaller:
        return 0.0
    middle = was.mean(axis=0)
    radius = float(np.sqrt(np.square(was - middle).sum(axis=1).mean()))
    reach = float(np.linalg.norm(np.ptp(was, axis=0))) + 2.0 * _CELL
    least = now.min(axis=0) - reach
    seen = _seen(now, bare, least, now.max(axis=0) + reach)
    turns = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    overlaps, sizes = [here], [0.0]
    for turn in np.where(turns > np.pi, turns - 2.0 * np.pi, turns):
        c, s = np.cos(turn), np.sin(turn)
        turned = (was - middle) @ np.array([[c, s], [-s, c]])
        low = turned.min(axis=0)
        shape = _image(turned - low)
        # Placed with its first cell so many cells behind the first one of what is seen.
        overlap = cv2.matchTemplate(seen, shape, cv2.TM_CCORR)
        y, x = np.indices(overlap.shape)
        ways = least + np.stack([x, y], axis=-1) * _CELL - low - middle
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


def _seen(now: Array, bare: shapely.Geometry, low: Array, high: Array) -> Array:
    """The cells (rows, columns) between two corners: 1 in an object, -1 where the table is bare."""
    columns, rows = np.ceil((high - low) / _CELL).astype(int)
    x, y = (low[i] + _CELL * np.arange(n) for i, n in enumerate((columns, rows)))
    seen = -shapely.contains_xy(bare, *np.meshgrid(x, y)).astype(np.float32)
    u, v = np.round((now.min(axis=0) - low) / _CELL).astype(int)
    own = _image(now - now.min(axis=0))
    window = seen[v : v + own.shape[0], u : u + own.shape[1]]
    window[own > 0.0] = 1.0
    return seen


def _image(points: Array) -> Array:
    """The cells (rows, columns) in which points (N, 2) are, whose least coordinates are zero."""
    columns, rows = np.round(points / _CELL).astype(int).T
    image = np.zeros((rows.max() + 1, columns.max() + 1), np.float32)
    image[rows, columns] = 1.0
    # A turned grid leaves holes.
    return np.asarray(cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((3, 3))))
