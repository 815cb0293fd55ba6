"""Whether a camera sees another view than before: it was moved, or most of what it sees has.

A depth sensor that has changed leaves the colour image as it was.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.immutable import Immutable
from crossmodal.maths.optical_flow import flow

_CORNERS, _LEAST = 100, 10
_QUALITY, _APART = 0.02, 15  # Of a corner beside the best one; distance between two, [px].
_MAX_ERROR = 1.0  # Of a corner that is followed there and back, [px].
_MOVED = 0.5  # Of most corners; flow is known to a tenth of it, [px].


@dataclass(frozen=True)
class View(Immutable):
    """A grey image (H, W) and the corners (N, 2) in it that are not on the robot, [px]."""

    image: npt.NDArray[np.float32]
    corners: npt.NDArray[np.float32]


def view_of(color: Any, robot: Any) -> View:
    """The view of colours (H, W, 4) with the robot's mask (H, W, 1), None if not known."""
    grey = _grey(color)
    free = None if robot is None else np.where(robot[:, :, 0] == 0, np.uint8(255), np.uint8(0))
    found = cv2.goodFeaturesToTrack(grey, _CORNERS, _QUALITY, _APART, mask=free)
    corners = np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)
    return View(image=grey, corners=np.asarray(corners, np.float32))


def is_another(before: View, color: Any) -> bool:
    """Whether most corners of a view are elsewhere by now; no where too few are found again."""
    uv, found = flow(before.image, _grey(color), before.corners.astype(float), _MAX_ERROR)
    if np.sum(found) < _LEAST:
        return False
    moved = np.linalg.norm(uv[found] - before.corners[found], axis=1)
    return float(np.median(moved)) > _MOVED


def _grey(color: Any) -> npt.NDArray[np.float32]:
    grey = cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGBA2GRAY)
    return np.asarray(cv2.GaussianBlur(grey, (5, 5), 1.0), np.float32)
