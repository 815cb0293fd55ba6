"""Images of ROS as arrays: colour as RGB, depth in metres, from all usual encodings."""

from typing import Any

import numpy as np
import numpy.typing as npt

from crossmodal.systems.recordings.recording import RecordingError

Color = npt.NDArray[np.uint8]
Depth = npt.NDArray[np.float32]

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED)
_LARGEST = 8192  # Width and height, [px].
# Numbers per pixel, their type, and where red, green and blue are among them.
_COLORS = {
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "8uc3": (3, (2, 1, 0)),  # As OpenCV has it.
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
    "8uc4": (4, (2, 1, 0)),
    "mono8": (1, (0, 0, 0)),
    "8uc1": (1, (0, 0, 0)),
}
_DEPTHS = {"16uc1": "u2", "mono16": "u2", "32fc1": "f4"}
_BAYER = {
    "bayer_rggb8": "COLOR_BayerRGGB2RGB",
    "bayer_bggr8": "COLOR_BayerBGGR2RGB",
    "bayer_gbrg8": "COLOR_BayerGBRG2RGB",
    "bayer_grbg8": "COLOR_BayerGRBG2RGB",
}
# Bytes before the PNG of a compressed depth: what it is, and two numbers of its quantisation.
_DEPTH_HEADER = 12
_MILLIMETRE = np.float32(1e-3)


def encoding_of(message: Any) -> str:
    """The encoding of an image, or the format of a compressed one."""
    return str(message.encoding if hasattr(message, "encoding") else message.format)


def is_depth(encoding: str) -> bool:
    """Whether an encoding is one of depth images; 8 bit are no depth."""
    return encoding.lower().split(";")[0].strip() in _DEPTHS


def size_of(message: Any) -> tuple[int, int]:
    """Width and height of an image, [px]; a compressed one is decompressed for it."""
    if hasattr(message, "encoding"):
        return int(message.width), int(message.height)
    image = _depth_image(message) if is_depth(message.format) else _decompressed(message.data)
    return image.shape[1], image.shape[0]


def color_of(message: Any) -> Color:
    """Red, green and blue (H, W, 3) of an `Image` or a `CompressedImage`.

    Raises:
        RecordingError: for an encoding without colour or grey, and data that are not of its size.
    """
    if not hasattr(message, "encoding"):
        if is_depth(message.format):
            raise _not_a("colour image", message.format)
        return _with_three(_decompressed(message.data))
    name = message.encoding.lower()
    if name in _BAYER:
        import cv2

        code = getattr(cv2, _BAYER[name])
        return np.asarray(cv2.cvtColor(_pixels(message, 1, "u1")[:, :, 0], code), dtype=np.uint8)
    if name not in _COLORS:
        raise _not_a("colour image", message.encoding)
    channels, order = _COLORS[name]
    return np.ascontiguousarray(_pixels(message, channels, "u1")[:, :, order])


def depth_of(message: Any) -> Depth:
    """Depths (H, W), [m], of an `Image` or a `CompressedImage`; zero where nothing was measured.

    Raises:
        RecordingError: for an encoding without depth, and data that are not of its size.
    """
    if not hasattr(message, "encoding"):
        if not is_depth(message.format):
            raise _not_a("depth image", message.format)
        return _metres(_depth_image(message))
    name = message.encoding.lower()
    if name not in _DEPTHS:
        raise _not_a("depth image", message.encoding)
    return _metres(_pixels(message, 1, _DEPTHS[name])[:, :, 0])


def _metres(image: npt.NDArray[Any]) -> Depth:
    """16 bit are millimetres. What is not measured is zero in one encoding, NaN in the other."""
    if image.dtype == np.uint16:
        return image.astype(np.float32) * _MILLIMETRE
    if image.dtype != np.float32:
        raise RecordingError(f"a depth image of {image.dtype}; need 16UC1 or 32FC1")
    return np.where(np.isnan(image), np.float32(0.0), image)


def _pixels(message: Any, channels: int, number: str) -> npt.NDArray[Any]:
    """The pixels (H, W, channels) of a raw image, whose rows may be padded."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    if not (0 < width <= _LARGEST and 0 < height <= _LARGEST):
        raise RecordingError(f"an image of {width} x {height} pixels; need 1 to {_LARGEST}")
    kind = np.dtype(number).newbyteorder(">" if message.is_bigendian else "<")
    row = width * channels * kind.itemsize
    step = step or row
    data: npt.NDArray[np.uint8] = np.frombuffer(message.data, dtype=np.uint8)
    if step < row or len(data) < step * (height - 1) + row:
        raise RecordingError(
            f"{len(data)} bytes with rows of {step} for {width} x {height} pixels of"
            f" {message.encoding}; record it again"
        )
    if len(data) < step * height:  # The last row may lack its padding.
        data = np.concatenate([data, np.zeros(step * height - len(data), dtype=np.uint8)])
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row])
    return rows.view(kind).reshape(height, width, channels).astype(kind.newbyteorder("="))


def _decompressed(data: Any) -> npt.NDArray[Any]:
    import cv2

    encoded: npt.NDArray[np.uint8] = np.frombuffer(data, dtype=np.uint8)
    try:
        image = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED) if len(encoded) else None
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError("a compressed image that is no JPEG or PNG; record it again")
    return np.asarray(image)


def _with_three(image: npt.NDArray[Any]) -> Color:
    """RGB of what OpenCV gives: blue first, or grey."""
    if image.dtype != np.uint8:
        raise RecordingError(f"a compressed colour image of {image.dtype}; need 8 bit")
    if image.ndim == 2:
        return np.repeat(image[:, :, None], 3, axis=2)
    return np.ascontiguousarray(image[:, :, 2::-1])


def _depth_image(message: Any) -> npt.NDArray[Any]:
    """A compressed depth image: a PNG, with a header before it where it is `compressedDepth`.

    Depths of 32 bit are quantised as a / (k - b), k of 16 bit and zero where nothing was measured.
    """
    kind = message.format.lower()
    if "compresseddepth" not in kind:
        return _decompressed(message.data)
    if "rvl" in kind:
        raise RecordingError(
            f"depth images of the format '{message.format}'; republish them as compressedDepth png"
        )
    data = bytes(message.data)
    if len(data) <= _DEPTH_HEADER:
        raise RecordingError("a compressed depth image without data; record it again")
    image = _decompressed(data[_DEPTH_HEADER:])
    if not kind.startswith("32fc1"):
        return image
    a, b = np.frombuffer(data, dtype="<f4", count=2, offset=4)
    k = image.astype(np.float32)
    return np.where(k > b, a / np.maximum(k - b, np.float32(1e-6)), np.float32(0.0))


def _not_a(what: str, encoding: str) -> RecordingError:
    known = _DEPTHS if what.startswith("depth") else [*_COLORS, *_BAYER]
    return RecordingError(
        f"the encoding '{encoding}' is no {what}; need {', '.join(known)}: choose another topic or"
        " convert it by image_proc"
    )
