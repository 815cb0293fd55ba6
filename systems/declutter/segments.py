"""Objects on a table from masks in an image: outlines on the table's plane, and their numbers.

A pixel of an outline is moved along its ray to the height at which the depth image sees it, and
from there straight down. Without depth it is moved to the table itself, so that what is high is
shown behind its place, farther from the camera, and too large: then let the camera look from above.
"""

from dataclasses import replace
from itertools import count, product

import cv2
import numpy as np
import shapely
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import linear_sum_assignment

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import Segment

INNER = 0.8  # Of an outline's size.
_TOLERANCE = 1.0  # By how much an outline is simplified, [px].
_AROUND = 3  # A corner's height is the median of the object's so many pixels around it.
_TOP = 0.98  # The quantile of an object's heights that is its top: a few are wrong.


def inner_part(segment: Segment) -> shapely.Polygon:
    """The hull of an object's outline, smaller about its centroid, in W, [m].

    On its way it meets what lies ahead, and not what only touches the object from the side.
    """
    corners = shapely.get_coordinates(segment.contour.convex_hull)
    return shapely.polygons(segment.centroid + INNER * (corners - segment.centroid))


def intersection_over_union(first: shapely.Geometry, second: shapely.Geometry) -> float:
    """0 to 1, of two polygons with an area."""
    return float(first.intersection(second).area / first.union(second).area)


def outline(mask: Mask) -> shapely.Polygon:
    """The polygon around the pixels of a mask (H, W), [px], without holes.

    What is seen in several parts gets their common hull: something lies over its middle.

    Raises:
        ValueError: for a mask without a pixel.
    """
    parts, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not parts:
        raise ValueError("the mask of an object has no pixel")
    filled: list[shapely.Polygon] = []
    for part in parts:
        # OpenCV's outline runs through the pixels' centres, and to and fro where it is thin.
        line = shapely.LineString(np.concatenate([part, part[:1]])[:, 0]).simplify(_TOLERANCE)
        # Shapely may tear a wide line apart, more often with mitred corners.
        wide = line.buffer(0.5, cap_style="square", quad_segs=2)
        filled.extend(shapely.Polygon(piece.exterior) for piece in shapely.get_parts(wide))
    return filled[0] if len(filled) == 1 else shapely.MultiPolygon(filled).convex_hull


def on_plane(uv: Array, intrinsics: Intrinsics, X_WC: Array, z: Array) -> Array:
    """Places (N, 2) in W of pixels (N, 2) on planes of heights z (N,), [m].

    Raises:
        ValueError: where a pixel's ray does not meet its plane in front of the camera.
    """
    rays = intrinsics.rays(uv, X_WC)
    down = X_WC[2, 3] - z
    if not (down * -rays[:, 2] > 0.0).all():
        raise ValueError("a pixel shows no point of the table: its ray does not meet the plane")
    return np.asarray(X_WC[:2, 3] + (down / -rays[:, 2])[:, None] * rays[:, :2])


def shown_part(
    region: shapely.Polygon, intrinsics: Intrinsics, X_WC: Array, z: float
) -> shapely.Geometry:
    """The part of a region in W that an image shows of a plane of height z, [m].

    All of it, where a corner of the image shows what is beyond the plane's horizon.
    """
    ends = [(0.0, float(size - 1)) for size in (intrinsics.width, intrinsics.height)]
    corners = np.array(list(product(*ends)))
    try:
        places = on_plane(corners, intrinsics, X_WC, np.full(len(corners), z))
    except ValueError:
        return region
    return region.intersection(shapely.MultiPoint(places).convex_hull)


def bare_part(
    shown: shapely.Geometry,
    seen: tuple[Segment, ...],
    masked: Mask,
    intrinsics: Intrinsics,
    X_WC: Array,
    z: float,
) -> shapely.Geometry:
    """Where an image shows a plane of height z itself, and neither objects nor robots.

    Nothing is known of it where one of them reaches above the plane's horizon.

    Args:
        shown: What of the plane is within the image.
        seen: The objects.
        masked: Pixels of the robots (H, W).
        intrinsics: Of the image.
        X_WC: Of the camera (4, 4).
        z: In W, [m].
    """
    pixels = [segment.pixels for segment in seen]
    if masked.any():
        pixels.append(outline(masked))

    def place(uv: Array) -> Array:
        return on_plane(uv, intrinsics, X_WC, np.full(len(uv), z))

    try:
        hidden = [shapely.make_valid(shapely.transform(there, place)) for there in pixels]
    except ValueError:
        return shapely.Polygon()
    return shown.difference(shapely.union_all([*hidden, *(s.contour for s in seen)]))


def still_there(
    before: tuple[Segment, ...], now: tuple[Segment, ...], shown: shapely.Geometry
) -> tuple[Segment, ...]:
    """The objects that a new image does not show since its border cuts them off, as before.

    Args:
        before: The objects until now.
        now: Those in the image, with the numbers that they had.
        shown: Part of the table that it shows, in W.
    """
    numbers = {segment.number for segment in now}
    seen = shapely.union_all([shown, *(segment.contour for segment in now)])
    return tuple(
        replace(segment, pixels=shapely.Polygon(), covered=0.0, is_cut=True)
        for segment in before
        if segment.number not in numbers and not seen.contains(segment.contour.centroid)
    )


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

    An outline that crosses itself, since its corners are moved by heights that are wrong, is made
    valid by Shapely: each part of it counts once.

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
    # Heights are only needed in the part of the image that shows the object.
    u, v, width, height = cv2.boundingRect(mask.astype(np.uint8))
    window = np.s_[v : v + height, u : u + width]
    heights = np.full((height, width), np.nan)
    if depth is not None:
        part = replace(
            intrinsics,
            width=width,
            height=height,
            center_x=intrinsics.center_x - u,
            center_y=intrinsics.center_y - v,
        )
        seen = np.maximum(part.heights(depth[window], X_WC, table), 0.0)
        heights = np.where(mask[window], seen, np.nan)

    def place(uv: Array) -> Array:
        z = _medians_around(heights, uv.round().astype(int) - (u, v))
        return on_plane(uv, intrinsics, X_WC, table + np.nan_to_num(z))

    contour = shapely.transform(pixels, place)
    known = heights[np.isfinite(heights)]
    return Segment(
        number=number,
        name=name,
        contour=shapely.make_valid(contour, method="structure", keep_collapsed=False),
        pixels=pixels,
        top=float(np.quantile(known, _TOP)) if known.size else np.nan,
    )


def _medians_around(heights: Array, corners: Ids) -> Array:
    """Medians (N,) of the known heights around pixels (N, 2); NaN where none is known."""
    side = 2 * _AROUND + 1
    windows = sliding_window_view(np.pad(heights, _AROUND, constant_values=np.nan), (side, side))
    u, v = np.clip(corners, 0, np.array(heights.shape[::-1]) - 1).T
    near = np.sort(windows[v, u].reshape(len(corners), -1), axis=1)  # NaN comes last.
    known = np.isfinite(near).sum(axis=1)
    middle = np.stack([np.maximum(known - 1, 0) // 2, known // 2], axis=1)
    return np.asarray(np.take_along_axis(near, middle, axis=1).mean(axis=1))


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
    far = np.full((len(seen), len(known)), np.inf)
    for (i, new), (j, old) in product(enumerate(seen), enumerate(known)):
        if new.name == old.name:
            far[i, j] = np.linalg.norm(new.centroid - old.centroid)
    pairs = dict(zip(*linear_sum_assignment(np.minimum(far, reach)), strict=True))
    fresh = count(1 + max((old.number for old in known), default=-1))
    numbers = [
        known[pairs[i]].number if i in pairs and far[i, pairs[i]] <= reach else next(fresh)
        for i in range(len(seen))
    ]
    return tuple(replace(new, number=n) for new, n in zip(seen, numbers, strict=True))
