"""The outline of an object in an image, as planes through the camera that the object touches."""

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import Intrinsics

_BESIDE = 2.0  # Pixels up to so far within the outermost ones are on the outline, too, [px].
_AROUND = 9  # So far around an outline pixel nothing else may be, [px].


def outline_planes(
    own: Mask, other: Mask, intrinsics: Intrinsics, R_WC: Array, count: int
) -> Array:
    """Unit vectors (T, 3) in W of planes through the eye which all of an object is behind.

    The outermost pixels along a direction in the image are where the object's convex hull ends, and
    a mask that lacks a part between others, as one of glass does, changes nothing about them. Where
    something else is beside them, which may hide a part, or where the image ends, nothing is known.

    Args:
        own: The object's pixels (H, W).
        other: Pixels of all else but what the object stands on (H, W).
        intrinsics: Of the image.
        R_WC: Rotation of the camera (3, 3).
        count: Of directions in the image, evenly around.
    """
    hidden = np.pad(other, 1, constant_values=True)
    kernel = np.ones((2 * _AROUND + 1, 2 * _AROUND + 1), np.uint8)
    hidden = cv2.dilate(hidden.astype(np.uint8), kernel)[1:-1, 1:-1].astype(bool)
    inner = cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    v, u = np.nonzero(own & ~inner)
    if len(u) == 0:
        return np.zeros((0, 3))
    angles = 2.0 * np.pi * np.arange(count) / count
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    heights = np.column_stack([u, v]) @ ways.T
    ends = heights.max(axis=0)
    outermost = heights > ends - _BESIDE
    known = ~(outermost & hidden[v, u][:, None]).any(axis=0)
    # The line ways . (u, v) = end in the image, and the camera, are in one plane.
    ends = ends + 0.5 - ways @ [intrinsics.center_x, intrinsics.center_y]
    n_C = np.column_stack([ways * [intrinsics.focal_x, intrinsics.focal_y], -ends])
    n_W = n_C[known] @ R_WC.T
    return np.asarray(n_W / np.linalg.norm(n_W, axis=1, keepdims=True))
