"""What a depth image shows of an object and of what is around it, seen straight from above.

A cell of such a map means the same length on the table wherever the camera was and wherever it
looked, and its axes are those of the world W, whose z is up. Heights are above the table.
"""

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

    @property
    def surroundings(self) -> Array:
        """Heights (CELLS, CELLS) of all that is there, [m]."""
        return np.maximum(self.heights, self.others)


def object_heights(
    depth: Array, labels: Ids, intrinsics: Intrinsics, X_WC: Array, table: float
) -> Array:
    """Heights (H, W) above the table, [m]; NaN where nothing was measured and no object is.

    What was not measured of an object, or only through it, is as high as its nearest pixel that
    was; where hardly any was, as of glass, all of it is taken to be 6 cm high.

    Args:
        depth: (H, W), [m]; zero, NaN or infinite where nothing was measured.
        labels: (H, W), numbers of objects, -1 where there is none.
        intrinsics: Of both.
        X_WC: Of the camera (4, 4).
        table: z of the table in W, [m].
    """
    measured = np.isfinite(depth) & (depth > 0.0)
    down = -_rays(intrinsics, X_WC)[..., 2]
    heights = np.where(measured, X_WC[2, 3] - table - np.where(measured, depth, 0.0) * down, np.nan)
    for label in np.unique(labels[labels >= 0]):
        mask = labels == label
        part = np.ix_(*(_extent(mask.any(axis=axis)) for axis in (1, 0)))
        mask, own = mask[part], heights[part]
        known = mask & (own > _LOWEST)
        if known.sum() < _SEEN * mask.sum():
            own[mask] = _UNSEEN_HEIGHT
        else:
            rows, columns = distance_transform_edt(
                ~known, return_distances=False, return_indices=True
            )
            own = np.where(mask, own[rows, columns], own)
        heights[part] = own
    return heights


def height_map(
    heights: Array, labels: Ids, label: int, intrinsics: Intrinsics, X_WC: Array, table: float
) -> HeightMap:
    """The map around the middle of an object.

    Args:
        heights: (H, W), see `object_heights`.
        labels: (H, W), numbers of objects, -1 where there is none.
        label: Number of the object.
        intrinsics: Of both.
        X_WC: Of the camera (4, 4), above the table.
        table: z of the table in W, [m].

    Raises:
        ValueError: where no pixel shows the object.
    """
    is_object = labels == label
    if not is_object.any():
        raise ValueError(f"no pixel shows object {label}")
    rays = _rays(intrinsics, X_WC)
    known = np.isfinite(heights) & (rays[..., 2] < 0.0)
    # Where a ray is at the height that was seen there.
    along = np.where(known, (X_WC[2, 3] - table - heights) / -rays[..., 2], np.nan)
    xy = X_WC[:2, 3] + along[..., None] * rays[..., :2]
    own = known & is_object
    middle = 0.5 * (xy[own].min(axis=0) + xy[own].max(axis=0))
    corner = middle - 0.5 * (CELLS - 1) * CELL
    # Between neighbouring pixels at most so many cells stay empty: they are filled.
    empty = int(np.ceil(np.nanmax(along[own]) / (CELL * min(intrinsics.vector()[:2]))))
    return HeightMap(
        heights=_seen_from_above(xy[own], heights[own], corner, empty),
        others=_seen_from_above(xy[known & ~is_object], heights[known & ~is_object], corner, empty),
        corner=corner,
    )


def highest_within(heights: Array) -> Array:
    """Of each cell (H, W) the greatest height within half a finger's width of it, [m]."""
    across = 2 * round(0.5 * WIDTH / CELL) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
    return np.asarray(cv2.dilate(heights, disc))


def _rays(intrinsics: Intrinsics, X_WC: Array) -> Array:
    """Of all pixels (H, W, 3), to where their depth is one, in W."""
    focal_x, focal_y, center_x, center_y = intrinsics.vector()
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    rays = np.stack([(u - center_x) / focal_x, (v - center_y) / focal_y, np.ones(u.shape)], -1)
    return np.asarray(rays @ X_WC[:3, :3].T)


def _extent(there: Mask) -> Ids:
    """Indices from the first to the last one that is there."""
    indices = np.flatnonzero(there)
    return np.arange(indices[0], indices[-1] + 1)


def _seen_from_above(xy: Array, heights: Array, corner: Array, empty: int) -> Array:
    """The greatest height in each cell (CELLS, CELLS), zero where there is none."""
    cells = np.round((xy - corner) / CELL).astype(int)
    inside = ((cells >= 0) & (cells < CELLS)).all(axis=1)
    seen = np.zeros((CELLS, CELLS))
    np.maximum.at(seen, (cells[inside, 1], cells[inside, 0]), heights[inside])
    return np.asarray(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((2 * empty + 1,) * 2)))
