"""Which pixels of a depth image show what lies near a point, or ahead of it."""

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.tracking.local_planes import InverseDepth, inverse_depth


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


@hot
def ahead(image: InverseDepth, p_CQ: Array, direction_C: Array, length: float) -> Mask:
    """The valid pixels (h, w) that show what lies up to `length` [m] beyond Q in a direction."""
    inside = np.zeros_like(image.valid)
    for row in range(image.w.shape[0]):
        for column in range(image.w.shape[1]):
            if image.valid[row, column]:
                z = 1.0 / image.w[row, column]
                along = (image.x[column] * z - p_CQ[0]) * direction_C[0]
                along += (image.y[row] * z - p_CQ[1]) * direction_C[1]
                along += (z - p_CQ[2]) * direction_C[2]
                inside[row, column] = 0.0 < along < length
    return inside
