"""The straight free edge of a flap in a depth image, before it is touched."""

from typing import NamedTuple

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.flap.tracking.flap_region import InverseDepth
from crossmodal.systems.flap.tracking.plane_fit import PlaneFit, near_plane

_GATE = 3.0  # Standard deviations within which a place belongs to the line.
_ROUNDS = 5  # Of fitting the line to the places that belong to it.
_BEYOND = 3  # What would hide the edge is looked for so far beyond it, [px].


class EdgeFit(NamedTuple):
    """A line in a flap's plane, in the camera's frame C.

    Attributes:
        direction_C: Unit vector (3,), along the finger.
        p_CE: Point on it (3,), the middle of what is seen, [m].
    """

    direction_C: Array
    p_CE: Array


def free_edge(
    image: InverseDepth,
    fit: PlaneFit,
    near: Mask,
    excluded: Array | None,
    axes_C: tuple[Array, Array],
    intrinsics: Intrinsics,
    limit: float,
    correlation: int,
) -> EdgeFit | None:
    """The line along which the flap ends towards the finger; None where too little of it is seen.

    What is in the flap's plane but apart from it, as what the robot's mask leaves of the finger, is
    not the flap's. Across the edge, in strips of two pixels, the flap's pixel that is farthest
    towards the pad belongs to the edge, unless the robot is what ends the flap there.

    Args:
        fit: The flap's plane.
        near: Pixels (h, w) that may be the flap's.
        excluded: Nonzero on the robot (H, W), of the whole image; None if that is not known.
        axes_C: Of the fingertip, in C: y (3,) out of the pad, towards the edge, and z (3,) along
            the finger, about along the edge.
        limit: Of the residuals of the flap's pixels, [1/m].
        correlation: Side of the squares over which pixels share their noise, [px]; strips of three
            such squares are needed at least.
    """
    flap = near_plane(image, near, fit.m_C, limit).astype(np.uint8)
    count, labels, sizes, _ = cv2.connectedComponentsWithStats(flap)
    if count < 2:
        return None
    points = image.points(labels == 1 + np.argmax(sizes[1:, cv2.CC_STAT_AREA]))
    n = fit.m_C / np.linalg.norm(fit.m_C)
    e = axes_C[1] - n * (n @ axes_C[1])
    e /= np.linalg.norm(e)
    t = np.cross(e, n)
    t *= np.sign(t @ axes_C[0])
    middle = points.mean(axis=0)
    pixel = middle[2] / intrinsics.focal_x
    along, across = (points - middle) @ e, (points - middle) @ t
    strips = np.floor(along / (2.0 * pixel)).astype(int)
    order = np.lexsort((across, strips))
    first = order[np.unique(strips[order], return_index=True)[1]]
    first = first[~_is_hidden(points[first] - _BEYOND * pixel * t, excluded, intrinsics)]
    s, h = along[first], across[first]
    line, kept = np.zeros(2), np.ones(len(s), bool)
    for _ in range(_ROUNDS):
        if kept.sum() < 3 * correlation:
            return None
        line = np.polyfit(s[kept], h[kept], 1)
        off = np.abs(h - np.polyval(line, s))
        sigma = max(MEDIAN_TO_SIGMA * float(np.median(off[kept])), 0.5 * pixel)
        kept = off < _GATE * sigma
    direction = e + line[0] * t
    s_0 = float(s[kept].mean())
    return EdgeFit(
        direction / np.linalg.norm(direction),
        middle + s_0 * e + float(np.polyval(line, s_0)) * t,
    )


def _is_hidden(p_CQ: Array, excluded: Array | None, intrinsics: Intrinsics) -> Mask:
    """Which points (N, 3) the robot hides, or the border of the image."""
    if excluded is None:
        return np.zeros(len(p_CQ), bool)
    height, width = excluded.shape
    column, row = np.rint(intrinsics.project(p_CQ)).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    hidden = ~inside
    hidden[inside] = excluded[row[inside], column[inside]] != 0
    return hidden
