"""What a depth image shows of an object and of what is around it, seen straight from above.

A cell of such a map means the same length on the table wherever the camera was and wherever it
looked, and its axes are those of the world W, whose z is up. Heights are above the table.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.models.gripper_taxels import WIDTH

CELL = 0.002  # Edge of a cell, [m]: a pixel of the camera shows as much from .6 to 1.2 m.
CELLS = 150  # Along each edge: a map of 30 cm holds the largest of the objects.

_LOWEST = 0.006  # What is not higher is not seen of an object but through it, or beside it, [m].
_SEEN = 0.3  # Share of an object's pixels that must be measured for the others to be like them.
_UNSEEN_HEIGHT = 0.06  # Else it is taken to be so high: half of what the fingers reach over, [m].
_NOWHERE = -(2**30)  # A cell.
_RIM = 4  # What is of no object and so near to one may be its rim, [cells].


@dataclass(frozen=True, kw_only=True)
class HeightMap(Immutable):
    """Of one object, (CELLS, CELLS); rows run along y of W and columns along x.

    Attributes:
        heights: Of the object, zero where it is not, [m].
        others: Of all that is not the object, zero where nothing is seen, [m].
        corner: Place (2,) in W of the middle of the first cell, [m].
    """

    heights: Array
    others: Array
    corner: Array

    def cells(self, xy: Array) -> Array:
        """Column and row (..., 2) of places (..., 2) in W, not rounded."""
        return np.asarray((xy - self.corner) / CELL)

    def places(self, cells: Array) -> Array:
        """Places (..., 2) in W of columns and rows (..., 2), [m]."""
        return np.asarray(self.corner + CELL * cells)


@dataclass(frozen=True, kw_only=True)
class SeenPoints(Immutable):
    """What each pixel of an image shows, (H, W).

    Attributes:
        cells: Column and row (2, H, W) of a grid on the table whose first cell is at the origin of
            W; far outside where nothing is known.
        heights: Above the table, [m]; NaN where nothing is known.
        highest: At most, where it is not seen how high it is; else the same, [m].
        labels: Number of the object, -1 where there is none.
        gap: So many cells of a map at most lie between the places of neighbouring pixels.
    """

    cells: Ids
    heights: Array
    highest: Array
    labels: Ids
    gap: int


def seen_points(
    depth: Array,
    labels: Ids,
    intrinsics: Intrinsics,
    X_WC: Array,
    table: float,
    glass: Mapping[int, float] | None = None,
) -> SeenPoints:
    """The points that a camera above the table sees.

    What was not measured of an object, or only through it, is as high as its nearest pixel that
    was; where hardly any was, as of glass, all of it is taken to be 6 cm high.

    Args:
        depth: (H, W), [m]; zero, NaN or infinite where nothing was measured.
        labels: (H, W), numbers of objects, -1 where there is none.
        intrinsics: Of both.
        X_WC: Of the camera (4, 4).
        table: z of the table in W, [m].
        glass: Numbers of objects through which the camera looks, and their greatest heights, [m].
    """
    heights = intrinsics.heights(depth, X_WC, table)
    for label in np.unique(labels[labels >= 0]):
        _fill(heights, labels == label)
    highest = heights.copy()
    for label, bound in (glass or {}).items():
        highest[labels == label] = bound
    # Where a ray is at the height that was seen there.
    rays = intrinsics.image_rays(X_WC)
    down = X_WC[2, 3] - table - heights
    along = np.where(rays[..., 2] < 0.0, down / -rays[..., 2], np.nan)
    farthest = np.nanmax(along[labels >= 0], initial=0.0)
    xy = X_WC[:2, 3, None, None] + along * np.moveaxis(rays[..., :2], -1, 0)
    return SeenPoints(
        cells=np.where(np.isfinite(along), np.round(xy / CELL), _NOWHERE).astype(np.int32),
        heights=heights,
        highest=highest,
        labels=labels,
        gap=int(np.ceil(farthest / (CELL * min(intrinsics.focal_x, intrinsics.focal_y)))),
    )


def _fill(heights: Array, mask: Mask) -> None:
    """Writes heights (H, W) of an object's pixels where they are not known."""
    part = np.ix_(*(_extent(np.asarray(mask.any(axis=axis))) for axis in (1, 0)))
    mask, own = mask[part], heights[part]
    known = mask & (own > _LOWEST)
    if known.sum() < _SEEN * mask.sum():
        own[mask] = _UNSEEN_HEIGHT
    else:
        rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
        own = np.where(mask, own[rows, columns], own)
    heights[part] = own


def height_map(seen: SeenPoints, label: int) -> HeightMap:
    """The map around the middle of an object.

    Raises:
        ValueError: where no pixel shows the object.
    """
    own = seen.cells[:, (seen.labels == label) & (seen.cells[0] > _NOWHERE)]
    if not own.size:
        raise ValueError(f"no pixel shows object {label}")
    first = (own.min(axis=1) + own.max(axis=1) - CELLS) // 2 + 1
    columns, rows = (of - at for of, at in zip(seen.cells, first, strict=True))
    inside = np.flatnonzero((columns >= 0) & (columns < CELLS) & (rows >= 0) & (rows < CELLS))
    cells = CELLS * rows.ravel()[inside] + columns.ravel()[inside]
    labels, gap = seen.labels.ravel()[inside], seen.gap
    is_object, is_beside = labels == label, labels < 0
    is_other = ~(is_object | is_beside)
    heights, highest = seen.heights.ravel()[inside], seen.highest.ravel()[inside]
    heights, others, beside = (
        _from_above(cells[chosen], values[chosen], gap)
        for chosen, values in ((is_object, heights), (is_other, highest), (is_beside, heights))
    )
    rim = cv2.dilate(heights, np.ones((2 * _RIM + 1,) * 2)) > 0.0
    return HeightMap(
        heights=heights, others=np.maximum(others, np.where(rim, 0.0, beside)), corner=CELL * first
    )


def highest_within(heights: Array) -> Array:
    """Of each cell (H, W) the greatest height within half a finger's width of it, [m]."""
    across = 2 * round(0.5 * WIDTH / CELL) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
    return np.asarray(cv2.dilate(heights, disc))


def _extent(there: Mask) -> Ids:
    """Indices from the first to the last one that is there."""
    indices = np.flatnonzero(there)
    return np.arange(indices[0], indices[-1] + 1)


def _from_above(cells: Ids, heights: Array, gap: int) -> Array:
    """The greatest of heights (N,) in each cell (CELLS, CELLS), zero where there is none.

    Args:
        cells: Numbers (N,) of cells, row by row.
        heights: In them, [m].
        gap: See `SeenPoints`.
    """
    found = np.zeros(CELLS * CELLS)
    np.maximum.at(found, cells, heights)
    closing = np.ones((2 * gap + 1,) * 2)
    return np.asarray(cv2.morphologyEx(found.reshape(CELLS, CELLS), cv2.MORPH_CLOSE, closing))
