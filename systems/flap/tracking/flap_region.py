"""Which pixels of a depth image show what lies near a point, and the plane around each pixel.

A plane m · p = 1 appears in the inverse depth as w = 1/z = m · r with the ray r = (x, y, 1), so
that a least squares fit of w in a window is a plane fit that knows the pinhole camera.
"""

from typing import NamedTuple

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot
from crossmodal.systems.depth_camera import DepthCamera


class InverseDepth(NamedTuple):
    """A part of a depth image.

    Attributes:
        w: Inverse depth (h, w), 0 where nothing returned, [1/m].
        valid: Where something did (h, w).
        x: Of the columns' rays (w,): (u - center_x) / focal_x.
        y: Of the rows' rays (h,): (v - center_y) / focal_y.
    """

    w: Array
    valid: Mask
    x: Array
    y: Array

    def points(self, pixels: Mask) -> Array:
        """The points (N, 3) of some pixels in the camera's frame, [m]."""
        rows, columns = np.nonzero(pixels)
        z = 1.0 / self.w[rows, columns]
        return np.column_stack([self.x[columns] * z, self.y[rows] * z, z])

    def residuals(self, m_C: Array) -> Array:
        """Inverse depth (h, w) less that of a plane m · p = 1 (3,), [1/m]."""
        return np.asarray(self.w - m_C[0] * self.x - (m_C[1] * self.y + m_C[2])[:, None])


class LocalPlanes(NamedTuple):
    """Planes at the pixels of a grid.

    Attributes:
        m_C: Planes m · p = 1 (N, 3), [1/m].
        mean_square: Of the residuals of the inverse depth (N,), [1/m^2].
        rows: Of the window's centre (N,), [px].
        columns: Likewise.
    """

    m_C: Array
    mean_square: Array
    rows: Ids
    columns: Ids


def inverse_depth(
    depth: Array, intrinsics: Array, box: tuple[int, int, int, int], excluded: Array | None
) -> InverseDepth:
    """The part of a depth image in a box.

    Args:
        depth: (H, W), [m]; 0, NaN and infinity are no return.
        intrinsics: (focal_x, focal_y, center_x, center_y), [px].
        box: First and last row, first and last column, the last ones excluded.
        excluded: Nonzero where there is something else (H, W), as the robot.
    """
    top, bottom, left, right = box
    z = depth[top:bottom, left:right].astype(float)
    valid = np.isfinite(z) & (z > 0.0)
    if excluded is not None:
        valid &= excluded[top:bottom, left:right] == 0
    w = np.divide(1.0, z, out=np.zeros_like(z), where=valid)
    x = (np.arange(left, right) - intrinsics[2]) / intrinsics[0]
    y = (np.arange(top, bottom) - intrinsics[3]) / intrinsics[1]
    return InverseDepth(w, valid, x, y)


def fit_local_planes(
    image: InverseDepth, window: int, stride: int, least_share: float
) -> LocalPlanes:
    """Least squares planes in square windows.

    Every second pixel of every second row is looked at: neighbours share their noise.

    Args:
        window: Side of the window, [px].
        stride: Between the windows' centres, even, [px].
        least_share: Of a window's pixels that must have returned.
    """
    window, stride = 2 * (window // 4) + 1, stride // 2
    one = image.valid[::2, ::2].astype(float)
    ray_x, ray_y = image.x[::2], image.y[::2, None]
    x, y, w = ray_x * one, ray_y * one, image.w[::2, ::2] * one
    terms = (one, x, y, w, x * ray_x, x * ray_y, y * ray_y, x * w, y * w, w * w)
    size, grid = (window, window), np.s_[::stride, ::stride]
    sums = [
        cv2.boxFilter(term, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)[grid]
        for term in terms
    ]
    count = np.maximum(sums[0], 1.0)
    mx, my, mw = (part / count for part in sums[1:4])
    cxx, cxy, cyy = sums[4] / count - mx * mx, sums[5] / count - mx * my, sums[6] / count - my * my
    cxw, cyw, cww = sums[7] / count - mx * mw, sums[8] / count - my * mw, sums[9] / count - mw * mw
    determinant = cxx * cyy - cxy * cxy
    full = (2.0 * (image.x[1] - image.x[0])) ** 2 * (window**2 - 1) / 12.0
    good = (sums[0] >= least_share * window**2) & (determinant > (0.3 * full) ** 2)
    safe = np.where(good, determinant, 1.0)
    a, b = (cyy * cxw - cxy * cyw) / safe, (cxx * cyw - cxy * cxw) / safe
    m = np.stack([a, b, mw - a * mx - b * my], axis=-1)[good]
    residual = np.maximum(cww - a * cxw - b * cyw, 0.0)[good]
    rows, columns = np.nonzero(good)
    return LocalPlanes(m, residual, 2 * stride * rows, 2 * stride * columns)


def normals(m_C: Array) -> Array:
    """Unit normals (N, 3) towards the camera, of planes m · p = 1 (N, 3)."""
    return np.asarray(-m_C / np.linalg.norm(m_C, axis=-1, keepdims=True))


def crop(
    depth: Array, excluded: Array | None, camera: DepthCamera, p_WQ: Array, radius: float
) -> InverseDepth | None:
    """What lies in the ball of `radius` [m] about Q; None where the image does not show it."""
    X_WC, intrinsics = camera.X_WC, camera.intrinsics.vector()
    p_CQ = X_WC[:3, :3].T @ (p_WQ - X_WC[:3, 3])
    nearest = p_CQ[2] - radius
    if not nearest > 0.0:
        return None
    centre = p_CQ[:2] / p_CQ[2] * intrinsics[:2] + intrinsics[2:]
    half = intrinsics[:2] * radius / p_CQ[2]
    height, width = depth.shape
    (left, top), (right, bottom) = centre - half, centre + half + 1.0
    columns = np.clip([left, right], 0, width).astype(int)
    rows = np.clip([top, bottom], 0, height).astype(int)
    if columns[1] - columns[0] < 2 or rows[1] - rows[0] < 2:
        return None
    box = int(rows[0]), int(rows[1]), int(columns[0]), int(columns[1])
    image = inverse_depth(depth, intrinsics, box, excluded)
    valid = within(image, p_CQ, radius)
    column, row, width, height = cv2.boundingRect(valid.astype(np.uint8))
    i, j = _at_least_two(row, height, valid.shape[0]), _at_least_two(column, width, valid.shape[1])
    # Copies, so that all images are compiled for as one type.
    return InverseDepth(image.w[i, j].copy(), valid[i, j].copy(), image.x[j], image.y[i])


def _at_least_two(first: int, count: int, size: int) -> slice:
    """Some of `size` >= 2 rows or columns, of which there must be two for rays to be apart."""
    first = min(first, size - 2)
    return slice(first, first + max(count, 2))


@hot
def within(image: InverseDepth, p_CQ: Array, radius: float) -> Mask:
    """The valid pixels (h, w) that show something within `radius` [m] of Q (3,)."""
    inside = np.zeros_like(image.valid)
    for row in range(image.w.shape[0]):
        for column in range(image.w.shape[1]):
            if image.valid[row, column]:
                z = 1.0 / image.w[row, column]
                a, b = image.x[column] * z - p_CQ[0], image.y[row] * z - p_CQ[1]
                inside[row, column] = a * a + b * b + (z - p_CQ[2]) ** 2 < radius * radius
    return inside


def ahead(image: InverseDepth, m_C: Array, p_CQ: Array, direction_C: Array, length: float) -> Mask:
    """The valid pixels (h, w) at which a plane lies up to `length` [m] beyond Q in a direction.

    A pixel's own noise does not decide whether it is one of them, since what is fitted to pixels
    that are chosen by their noise is tilted.

    Args:
        m_C: The plane m · p = 1 (3,).
    """
    w = m_C[0] * image.x + (m_C[1] * image.y + m_C[2])[:, None]
    along = direction_C[0] * image.x + (direction_C[1] * image.y + direction_C[2])[:, None]
    beyond = along - float(p_CQ @ direction_C) * w  # Times the inverse depth, which is positive.
    return np.asarray(image.valid & (w > 0.0) & (beyond > 0.0) & (beyond < length * w))
