"""What one depth image shows of an object that stands on a table: points on it, rays beside it."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import number

_BEFORE_WHAT_IS_BEHIND = 0.01  # Of a line of sight is not taken for free, [m].
_PLANE_STEPS = 6
_FEWEST = 50  # Pixels by which a plane is known.


@dataclass(kw_only=True)
class TargetViewConfig:
    """How an object's pixels are told from others."""

    # Least height above the table of what belongs to the object.
    margin: float = number(0.005, above=0.0, at_most=1.0, unit="m")
    # Farther than this from where the table is believed to be, nothing belongs to it.
    table_error: float = number(0.02, above=0.0, at_most=1.0, unit="m")
    # Steps of depth between neighbours that are edges, at which depth is not to be trusted.
    edge: float = number(0.015, above=0.0, at_most=1.0, unit="m")
    # Points are so far apart along rows and columns: a depth camera matches patches, and depths
    # whose patches overlap share their errors.
    apart: int = number(9, at_least=1, at_most=100, unit="px")
    # Lines of sight close beside the object along which nothing is; none where it is transparent.
    lines: int = number(20, at_least=0, at_most=10000)
    # Planes that touch the outline of an object through which depth looks, where its pixels are
    # known.
    planes: int = number(12, at_least=0, at_most=1000)
    # Standard deviation of the outline of a mask. In four recorded views (tuning seeds 59 and 63)
    # masks were up to 2 px too large on all sides, and as far off by chance.
    outline_error: float = number(4.0, above=0.0, at_most=100.0, unit="px")


@dataclass(frozen=True, kw_only=True)
class TargetView:
    """Of one image.

    Attributes:
        p_WP: Points on the object (N, 3), in W, [m].
        depth: Of these, along the camera's axis (N,), [m].
        passed: Directions (B, 3) in W of the rays that passed by the object.
        free: Start and end (R, 2, 3) in W of the parts of some of these along which nothing is,
            [m].
    """

    p_WP: Array
    depth: Array
    passed: Array
    free: Array


def view_target(
    depth: Array,
    masked: Mask,
    own: Mask,
    intrinsics: Intrinsics,
    X_WC: Array,
    centre: Array,
    radius: float,
    height: float | None,
    config: TargetViewConfig,
) -> TargetView:
    """The object's points: those near where it is thought to be, and above the table.

    The table is seen, too: its plane is fitted, so that an error of the camera's pose does not
    make table of object or object of table.

    Args:
        depth: Image (H, W), [m]; zero, NaN or infinite where there is none.
        masked: Pixels of the robots (H, W).
        own: Pixels (H, W) that may be the object's.
        intrinsics: Of the image.
        X_WC: Pose of the camera (4, 4).
        centre: p_W (3,) about which the object is, [m].
        radius: Within which all of it is, [m].
        height: Of the table, about, [m]; None if the object stands on nothing that is known.
        config: Of the object's pixels.
    """
    usable = np.isfinite(depth) & (depth > 0.0) & ~masked
    z = np.where(usable, depth, 0.0).astype(np.float32)
    v, u = np.indices(depth.shape)
    x = (u - intrinsics.center_x) / intrinsics.focal_x
    y = (v - intrinsics.center_y) / intrinsics.focal_y
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    p_W = (z[..., None] * rays) @ X_WC[:3, :3].T + X_WC[:3, 3]
    near = usable & own & (np.linalg.norm(p_W - centre, axis=-1) < radius)
    if height is not None:
        near &= _above_table(p_W, usable, centre, radius, height, config)
    kernel = np.ones((3, 3), np.uint8)
    steps = cv2.dilate(z, kernel) - cv2.erode(z, kernel)
    chosen = near & (steps < config.edge) & (u % config.apart == 0) & (v % config.apart == 0)
    index = np.flatnonzero(chosen)
    # Rays that do not end before the place of the object, and beside the object's own pixels.
    to_centre = centre - X_WC[:3, 3]
    reached = np.linalg.norm(p_W - X_WC[:3, 3], axis=-1) > np.linalg.norm(to_centre) - radius
    beside = usable & reached & ~cv2.dilate(near.astype(np.uint8), kernel).astype(bool)
    to_end = p_W.reshape(-1, 3)[np.flatnonzero(beside)] - X_WC[:3, 3]
    length = np.linalg.norm(to_end, axis=1)
    passed = to_end / length[:, None]
    off = np.linalg.norm(to_centre - (passed @ to_centre)[:, None] * passed, axis=1)
    passed, length = passed[off < radius], length[off < radius]
    points, eye = p_W.reshape(-1, 3)[index], X_WC[:3, 3]
    return TargetView(
        p_WP=points,
        depth=z.ravel()[index].astype(float),
        passed=passed,
        free=lines_beside(
            eye, passed, length - _BEFORE_WHAT_IS_BEHIND, points, centre, radius, config.lines
        ),
    )


def lines_beside(
    eye: Array,
    passed: Array,
    ends: Array,
    points: Array,
    centre: Array,
    radius: float,
    most: int,
) -> Array:
    """Start and end (R, 2, 3) in W of lines of sight that passed closest to what was seen, [m].

    Args:
        eye: Where the camera is (3,), [m].
        passed: Directions (B, 3) of rays that passed by.
        ends: Up to where each is free (B,), from the eye, [m].
        points: On the object (N, 3), [m].
        centre: About which the object is (3,), [m].
        radius: Within which all of it is, [m].
        most: So many lines at most.
    """
    if most == 0 or len(passed) == 0 or len(points) == 0:
        return np.zeros((0, 2, 3))
    seen = points - eye
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    beside, _ = cKDTree(seen).query(passed)
    chosen = np.argsort(beside, kind="stable")[:most]
    d = passed[chosen]
    nearest = d @ (centre - eye)
    starts, stops = nearest - radius, np.minimum(nearest + radius, ends[chosen])
    left = starts < stops
    along = np.stack([starts, stops], axis=1)[left]
    return np.asarray(eye + along[:, :, None] * d[left, None])


def _above_table(
    p_W: Array, usable: Mask, centre: Array, radius: float, height: float, config: TargetViewConfig
) -> Mask:
    """Pixels (H, W) above the plane that is seen of the table, or else that is believed."""
    beside = np.linalg.norm(p_W[..., :2] - centre[:2], axis=-1) < 2.0 * radius
    above = p_W[..., 2] - height
    near = usable & beside & (np.abs(above) < config.table_error)
    A = np.column_stack([p_W[near][:, :2] - centre[:2], np.ones(int(near.sum()))])
    b, plane = above[near], np.zeros(3)
    weight = np.ones(len(b), bool)
    for _ in range(_PLANE_STEPS):
        if weight.sum() < _FEWEST:
            plane = np.zeros(3)
            break
        plane = np.linalg.lstsq(A[weight], b[weight], rcond=None)[0]
        residual = b - A @ plane
        scale = MEDIAN_TO_SIGMA * float(np.median(np.abs(residual[weight])))
        weight = np.abs(residual) < max(2.5 * scale, 1e-4)
    offset = p_W[..., :2] - centre[:2]
    return np.asarray(above - offset @ plane[:2] - plane[2] > config.margin)
