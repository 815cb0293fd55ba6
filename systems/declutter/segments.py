"""Objects on a table from masks in an image: outlines on the table's plane, and their numbers.

A pixel of an outline is moved along its ray to the height at which the depth image sees it, and
from there straight down. Without depth it is moved to the table itself, so that what is high is
shown behind its place, farther from the camera, and too large: then let the camera look from above.
"""

from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.polygons import centroid, convex_hull, smallest_box
from crossmodal.systems.port_values import Segment

_TOLERANCE = 1.0  # By how much an outline is simplified, [px].
_AROUND = 3  # A corner's height is the median of the object's so many pixels around it.
_TOP = 0.98  # The quantile of an object's heights that is its top: a few are wrong.


def segment_of_contour(
    number: int,
    name: str,
    contour: Array,
    pixels: Array | None = None,
    top: float = np.nan,
) -> Segment:
    """An object with this outline (N, 2), in W, [m]; for the rest see `Segment`."""
    return Segment(
        number=number,
        name=name,
        contour=contour,
        pixels=np.zeros((0, 2)) if pixels is None else pixels,
        box=smallest_box(contour),
        centroid=centroid(contour),
        top=top,
    )


def outline(mask: Mask) -> Array:
    """Corners (N, 2) of the polygon around a mask (H, W), [px].

    What is seen in several parts gets their common hull: something lies over its middle.

    Raises:
        ValueError: for a mask without a pixel.
    """
    # OpenCV's outlines of connected parts run through the pixels' centres.
    parts, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not parts:
        raise ValueError("the mask of an object has no pixel")
    if len(parts) > 1:
        return convex_hull(np.concatenate(parts)[:, 0].astype(float))
    return np.asarray(cv2.approxPolyDP(parts[0], _TOLERANCE, True)[:, 0], dtype=float)


def on_plane(uv: Array, intrinsics: Intrinsics, X_WC: Array, z: Array) -> Array:
    """Places (N, 2) in W of pixels (N, 2) on planes of heights z (N,), [m].

    Raises:
        ValueError: where a pixel's ray does not meet its plane in front of the camera.
    """
    focal_x, focal_y, center_x, center_y = intrinsics.vector()
    u, v = (uv - (center_x, center_y)).T
    rays = np.column_stack([u / focal_x, v / focal_y, np.ones(len(uv))]) @ X_WC[:3, :3].T
    down = X_WC[2, 3] - z
    if not (down * -rays[:, 2] > 0.0).all():
        raise ValueError("a pixel shows no point of the table: its ray does not meet the plane")
    return np.asarray(X_WC[:2, 3] + (down / -rays[:, 2])[:, None] * rays[:, :2])


def segment_of_mask(
    number: int,
    name: str,
    mask: Mask,
    intrinsics: Intrinsics,
    X_WC: Array,
    table: float,
    depth: Array | None = None,
) -> Segment:
    """An object from its mask.

    Args:
        number: Of the object.
        name: Of its class; empty for none.
        mask: (H, W).
        intrinsics: Of the camera.
        X_WC: Of the camera (4, 4), where it is believed to have been.
        table: z of the table's plane in W, [m].
        depth: (H, W) along the camera's axis, [m]; zero, NaN or infinite where nothing was
            measured, there the table is taken.

    Raises:
        ValueError: for a mask without a pixel, and where a pixel's ray misses the table.
    """
    pixels = outline(mask)
    heights, top = np.zeros(len(pixels)), np.nan
    if depth is not None:
        measured = _heights(mask, intrinsics, X_WC, table, depth)
        around = [_median_around(measured, corner) for corner in pixels.astype(int)]
        heights = np.nan_to_num(np.array(around))
        if np.isfinite(measured).any():
            top = float(np.quantile(measured[np.isfinite(measured)], _TOP))
    contour = on_plane(pixels, intrinsics, X_WC, table + heights)
    return segment_of_contour(number, name, contour, pixels, top)


def _heights(mask: Mask, intrinsics: Intrinsics, X_WC: Array, table: float, depth: Array) -> Array:
    """Heights (H, W) above the table, at least zero; NaN where none was measured."""
    v, u = np.indices(mask.shape)
    x = (u - intrinsics.center_x) / intrinsics.focal_x
    y = (v - intrinsics.center_y) / intrinsics.focal_y
    known = mask & np.isfinite(depth) & (depth > 0.0)
    z = (
        X_WC[2, 3]
        + np.where(known, depth, 0.0) * (X_WC[2, 0] * x + X_WC[2, 1] * y + X_WC[2, 2])
        - table
    )
    return np.where(known, np.maximum(z, 0.0), np.nan)


def _median_around(heights: Array, corner: Array) -> float:
    u, v = np.maximum(corner - _AROUND, 0)
    near = heights[v : corner[1] + _AROUND + 1, u : corner[0] + _AROUND + 1]
    known = near[np.isfinite(near)]
    return float(np.median(known)) if known.size else np.nan


def with_known_numbers(
    seen: tuple[Segment, ...], known: tuple[Segment, ...], reach: float
) -> tuple[Segment, ...]:
    """The objects of a new image, with the numbers that they had before.

    Objects of a class are paired so that all distances together are least, each counted up to the
    reach. What is in no pair within it gets a number that nobody has had among those known.

    Args:
        seen: In the new image, with any numbers.
        known: All that were ever seen, each as it was last.
        reach: Farthest distance that an object has gone since, [m].
    """
    far = np.array([[_far(new, old) for old in known] for new in seen], dtype=float).reshape(
        len(seen), len(known)
    )
    rows, columns = linear_sum_assignment(np.minimum(far, reach))
    pairs = {i: j for i, j in zip(rows, columns, strict=True) if far[i, j] <= reach}
    fresh = 1 + max((old.number for old in known), default=-1)
    numbered = []
    for i, new in enumerate(seen):
        number = known[pairs[i]].number if i in pairs else fresh
        fresh += i not in pairs
        numbered.append(replace(new, number=number))
    return tuple(numbered)


def _far(new: Segment, old: Segment) -> float:
    return float(np.linalg.norm(new.centroid - old.centroid)) if new.name == old.name else np.inf
