"""Polygons in the plane: areas, hulls, smallest boxes, overlaps, distances.

A polygon is an array (N, 2) of its corners in order, without the first one again at the end; its
edges do not cross each other. Results are in float64; OpenCV's shapes are in float32.
"""

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _after(values: Array) -> Array:
    """What comes after each one (N, ...) in a circle; `np.roll` takes several times as long."""
    return np.concatenate([values[1:], values[:1]])


def _signed_area(polygon: Array) -> float:
    return 0.5 * float(_cross(polygon, _after(polygon)).sum())


def area(polygon: Array) -> float:
    """Of a polygon (N, 2) of either sense; zero for an empty one."""
    return abs(_signed_area(polygon))


def centroid(polygon: Array) -> Array:
    """Of the area of a polygon (N, 2); the mean of the corners (2,) where there is no area."""
    middle = polygon.mean(axis=0)
    own = polygon - middle
    after = _after(own)
    parts = _cross(own, after)
    if abs(parts.sum()) <= 1e-12 * np.square(own).sum():
        return np.asarray(middle)
    return np.asarray(middle + parts @ (own + after) / (3.0 * parts.sum()))


def convex_hull(points: Array) -> Array:
    """Corners (H, 2) of the hull of points (N, 2), counter-clockwise; fewer than 3 on a line."""
    own = points - points.mean(axis=0)
    chosen = cv2.convexHull(own.astype(np.float32), returnPoints=False).ravel()
    hull = points[chosen]
    return np.asarray(hull if _signed_area(hull) >= 0.0 else hull[::-1])


def smallest_box(points: Array) -> Array:
    """Corners (4, 2), counter-clockwise, of the box of least area that holds points (N, 2).

    One of its edges lies on an edge of the hull. Of boxes of the same area it is the first one,
    from the hull's first edge on.
    """
    hull = convex_hull(points)
    edges = _after(hull) - hull
    lengths = np.linalg.norm(edges, axis=1)
    x = edges[lengths > 0.0] / lengths[lengths > 0.0, None] if lengths.any() else np.eye(2)[:1]
    frames = np.stack(
        [x, np.stack([-x[:, 1], x[:, 0]], axis=1)], axis=1
    )  # (E, 2, 2), axes in rows.
    inside = frames @ hull.T
    low, high = inside.min(axis=2), inside.max(axis=2)
    areas = np.prod(high - low, axis=1)
    best = int(np.argmax(areas <= areas.min() * (1.0 + 1e-9)))
    (left, bottom), (right, top) = low[best], high[best]
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    return np.asarray(corners @ frames[best])


def clipped(polygon: Array, convex: Array) -> Array:
    """What of a polygon (N, 2) lies in a convex one (M, 2), by Sutherland and Hodgman.

    Where that is several parts, lines of no area join them.
    """
    corners = convex if _signed_area(convex) >= 0.0 else convex[::-1]
    for start, end in zip(corners, _after(corners), strict=True):
        side = _cross(end - start, polygon - start)
        after, side_after = _after(polygon), _after(side)
        inside = side >= 0.0
        if inside.all():
            continue
        if not inside.any():
            return np.zeros((0, 2))
        crossing = inside != (side_after >= 0.0)
        share = np.divide(side, side - side_after, out=np.zeros_like(side), where=crossing)
        met = polygon + share[:, None] * (after - polygon)
        both, kept = np.repeat(polygon, 2, axis=0), np.repeat(inside, 2)
        both[1::2], kept[1::2] = met, crossing
        polygon = both[kept]
    return polygon


def intersection_over_union(polygon: Array, convex: Array) -> float:
    """0 to 1, of a polygon (N, 2) and a convex one (M, 2); zero where neither has an area."""
    if (polygon.max(axis=0) < convex.min(axis=0)).any():
        return 0.0
    if (convex.max(axis=0) < polygon.min(axis=0)).any():
        return 0.0
    common = area(clipped(polygon, convex))
    union = area(polygon) + area(convex) - common
    return common / union if union > 0.0 else 0.0


def contains(polygon: Array, points: Array) -> Mask:
    """Which of points (..., 2) lie in a polygon (N, 2); of those on its edge, either."""
    a, b = polygon, _after(polygon)
    p = points[..., None, :]
    spans = (a[:, 1] > p[..., 1]) != (b[:, 1] > p[..., 1])
    # Left of a rising edge, or right of a falling one: a ray along x meets that edge.
    meets = (_cross(b - a, p - a) > 0.0) == (b[:, 1] > a[:, 1])
    return np.asarray((spans & meets).sum(axis=-1) % 2 == 1)


def distance(first: Array, second: Array) -> float:
    """Least distance of two polygons (N, 2) and (M, 2); zero where they overlap."""
    if contains(first, second[0]) or contains(second, first[0]) or _cross_each_other(first, second):
        return 0.0
    return float(min(_to_edges(first, second).min(), _to_edges(second, first).min()))


def _cross_each_other(first: Array, second: Array) -> bool:
    a, b = first[:, None], _after(first)[:, None]
    c, d = second[None], _after(second)[None]
    by_first = _cross(b - a, c - a) * _cross(b - a, d - a) < 0.0
    by_second = _cross(d - c, a - c) * _cross(d - c, b - c) < 0.0
    return bool((by_first & by_second).any())


def _to_edges(points: Array, polygon: Array) -> Array:
    """Distances (N, M) of points from a polygon's edges."""
    start = polygon
    edge = _after(polygon) - start
    squared = np.square(edge).sum(axis=1)
    along = ((points[:, None] - start) * edge).sum(axis=-1)
    share = np.divide(along, squared, out=np.zeros_like(along), where=squared > 0.0)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * edge
    return np.asarray(np.linalg.norm(points[:, None] - nearest, axis=-1))
