"""The outline of an object in an image, as planes through the camera that the object touches."""

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.pinhole import Intrinsics

_AROUND = 9  # What is so near to the object in the image may hide a part of it, [px].
_BESIDE = 2.0  # By so much an outline may be farther out than its mask, [px].
_OUTSIDE = -2  # Number of what is beyond the image.


def outline_planes(
    own: Mask, others: Ids, intrinsics: Intrinsics, R_WC: Array, count: int
) -> Array:
    """Unit vectors (T, 3) in W of planes through the eye which all of an object is behind.

    The outermost pixels along a direction in the image are where the object's convex hull ends, and
    a mask that lacks a part between others, as one of glass does, changes nothing about them. Of
    directions in which something beside the object reaches as far, which may hide a part of it or
    be one, nothing is known; of an object that the end of the image cuts off, nothing at all.

    Args:
        own: The object's pixels (H, W).
        others: Numbers (H, W) of all other things but what the object stands on, -1 where none is.
        intrinsics: Of the image.
        R_WC: Rotation of the camera (3, 3).
        count: Of directions in the image, evenly around.
    """
    inner = cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    v, u = np.nonzero(own & ~inner)
    if len(u) == 0:
        return np.zeros((0, 3))
    angles = 2.0 * np.pi * np.arange(count) / count
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    ends = (np.column_stack([u, v]) @ ways.T).max(axis=0)
    kernel = np.ones((2 * _AROUND + 1, 2 * _AROUND + 1), np.uint8)
    around = cv2.dilate(np.pad(own, 1).astype(np.uint8), kernel).astype(bool)
    numbers = np.pad(others, 1, constant_values=_OUTSIDE)
    beside = np.setdiff1d(numbers[around], [-1])
    rows, columns = np.nonzero(np.isin(numbers, beside))
    reach = np.column_stack([columns - 1, rows - 1]) @ ways.T
    known = reach.max(axis=0, initial=-np.inf) < ends - _BESIDE
    # The line ways . (u, v) = end in the image, and the camera, are in one plane.
    ends = ends + 0.5 - ways @ [intrinsics.center_x, intrinsics.center_y]
    n_C = np.column_stack([ways * [intrinsics.focal_x, intrinsics.focal_y], -ends])
    n_W = n_C[known] @ R_WC.T
    return np.asarray(n_W / np.linalg.norm(n_W, axis=1, keepdims=True))
