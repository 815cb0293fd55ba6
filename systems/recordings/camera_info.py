"""Intrinsics of a camera from and in the `CameraInfo` of both versions of ROS."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.recordings.recording import RecordingError

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_MODELS = ("", "plumb_bob", "rational_polynomial", "equidistant", "fisheye")


@dataclass(frozen=True, kw_only=True)
class CameraFacts:
    """A camera's intrinsics and how its lens distorts.

    Attributes:
        intrinsics: Of the image as it is.
        distortion_model: As in ROS; empty without distortion.
        distortion: Coefficients in OpenCV's order; empty without distortion.
    """

    intrinsics: Intrinsics
    distortion_model: str = ""
    distortion: Array = field(default_factory=lambda: np.zeros(0))


def camera_facts(message: Any, *, is_rectified: bool) -> CameraFacts:
    """What a `CameraInfo` says of an image.

    Args:
        message: With `K`, `D`, `P` or, in ROS 2, `k`, `d`, `p`.
        is_rectified: Whether the image is rectified, so that `P` counts and nothing is distorted.

    Raises:
        RecordingError: for a camera that was never calibrated, or a lens that OpenCV has not.
    """
    K, D, P = (
        np.asarray(getattr(message, name, getattr(message, name.lower(), ())), dtype=float).ravel()
        for name in "KDP"
    )
    matrix = P.reshape(3, 4) if is_rectified and len(P) == 12 and P[0] > 0.0 else None
    if matrix is None:
        matrix = K.reshape(3, 3) if len(K) == 9 else np.zeros((3, 3))
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    width, height = int(message.width), int(message.height)
    if not (fx > 0.0 and fy > 0.0 and np.isfinite([fx, fy, cx, cy]).all() and width and height):
        raise RecordingError(
            "the camera info has no focal length; write it into the calibration's intrinsics"
        )
    bins = [max(int(getattr(message, f"binning_{axis}", 0)), 1) for axis in "xy"]
    intrinsics = Intrinsics(
        width=width, height=height, focal_x=fx, focal_y=fy, center_x=cx, center_y=cy
    )
    intrinsics = scaled(intrinsics, width // bins[0], height // bins[1])
    if is_rectified or not np.any(D):
        return CameraFacts(intrinsics=intrinsics)
    model = str(message.distortion_model)
    if model not in _MODELS:
        raise RecordingError(
            f"the distortion model '{model}' is not known; record rectified images (image_rect)"
        )
    return CameraFacts(intrinsics=intrinsics, distortion_model=model or "plumb_bob", distortion=D)


def scaled(intrinsics: Intrinsics, width: int, height: int) -> Intrinsics:
    """The intrinsics of the same view in an image of another size.

    Raises:
        RecordingError: where the image has another shape.
    """
    if (intrinsics.width, intrinsics.height) == (width, height):
        return intrinsics
    x, y = width / intrinsics.width, height / intrinsics.height
    if abs(x / y - 1.0) > 0.02:
        raise RecordingError(
            f"images of {width} x {height} pixels, but the camera info is of"
            f" {intrinsics.width} x {intrinsics.height}; write the intrinsics into the calibration"
        )
    return replace(
        intrinsics,
        width=width,
        height=height,
        focal_x=intrinsics.focal_x * x,
        focal_y=intrinsics.focal_y * y,
        center_x=(intrinsics.center_x + 0.5) * x - 0.5,
        center_y=(intrinsics.center_y + 0.5) * y - 0.5,
    )


def camera_info(lens: Intrinsics) -> dict[str, Any]:
    """The fields of a `CameraInfo` of images without distortion, but for its header."""
    fx, fy, cx, cy = lens.vector().tolist()
    return {
        "width": lens.width,
        "height": lens.height,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": np.eye(3).ravel(),
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
