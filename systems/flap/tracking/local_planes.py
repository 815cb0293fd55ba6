"""The plane around each pixel of a depth image, by box filters.

A plane m · p = 1 appears in the inverse depth as w = 1/z = m · r with the ray r = (x, y, 1), so
that a least squares fit of w in a window is a plane fit that knows the pinhole camera.
"""

from typing import NamedTuple

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask


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
        image: Part of a depth image.
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
