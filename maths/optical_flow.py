"""Optical flow of points between two images, whatever their exposure."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Mask

# Width of the window, [px], number of pyramid levels above the image, and when to stop.
_LUCAS_KANADE: dict[str, Any] = {
    "winSize": (21, 21),
    "maxLevel": 3,
    "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03),
}


def locally_normalised(image: npt.NDArray[np.float32], width: int = 31) -> npt.NDArray[np.uint8]:
    """The image with its local mean and standard deviation removed, for changes of exposure."""
    mean = cv2.blur(image, (width, width))
    variance = cv2.blur(image * image, (width, width)) - mean * mean
    scaled = (image - mean) * (40.0 / np.sqrt(np.maximum(variance, 0.0) + 4.0)) + 128.0
    return np.asarray(np.clip(scaled, 0.0, 255.0).astype(np.uint8))


def flow(
    before: npt.NDArray[np.float32],
    after: npt.NDArray[np.float32],
    uv: Array,
    max_error: float,
) -> tuple[Array, Mask]:
    """Pyramidal Lucas-Kanade from `before` to `after` and back.

    Args:
        before: Grey image (H, W).
        after: Likewise.
        uv: Pixels (N, 2) in `before`.
        max_error: How far from its start a point that is followed there and back may end, [px].

    Returns:
        Pixels (N, 2) in `after`, and which (N,) were found.
    """
    if len(uv) == 0:
        return uv, np.zeros(0, bool)
    images = locally_normalised(before), locally_normalised(after)
    start = uv.astype(np.float32).reshape(-1, 1, 2)
    forward, found, _ = cv2.calcOpticalFlowPyrLK(*images, start, None, **_LUCAS_KANADE)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(*images[::-1], forward, None, **_LUCAS_KANADE)
    error = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    success = (found.ravel() > 0) & (returned.ravel() > 0) & (error < max_error)
    return forward.reshape(-1, 2).astype(float), success
