"""What the segmentation network sees, and what its classes are called."""

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import Intrinsics

OTHER = "other"
# In the order of the network's outputs: what nothing lies on or is beyond the table, the goods, and
# any object that is none of them.
CLASSES = (
    "table",
    "black_box",
    "can",
    "cleaner",
    "duster",
    "marker",
    "oil",
    "screwdriver",
    "shampoo",
    "sponge",
    "spray",
    "transparent_box",
    "wineglass",
    OTHER,
)
TRANSPARENT = ("transparent_box", "wineglass")  # Goods that a camera looks through.
SHAPE = 6, 240, 320  # Channels, height and width.

_LOWEST, _HIGHEST = -0.1, 0.4  # Of the heights that are told apart, [m].
_UNIT = 0.1  # Of heights, so that they are about one, [m].


def network_input(
    colour: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.floating],
    masked: Mask | None,
    intrinsics: Intrinsics,
    X_WC: Array,
    table: float,
) -> npt.NDArray[np.float32]:
    """The channels that the network sees: what each pixel's height is, wherever the camera is.

    They are red, green and blue, -1 to 1; the height above the table, in tenths of a metre, zero
    where none was measured; whether none was measured; and the inverse of the depth at which the
    pixel's ray meets the table, [1/m], zero where it does not, so that the size of things is known
    where depth is missing.

    Args:
        colour: Red, green and blue (H, W, 3).
        depth: (H, W) along the camera's axis, [m]; zero, NaN or infinite where none was measured.
        masked: Pixels (H, W) that show the robot; they are made grey and without depth.
        intrinsics: Of both images.
        X_WC: Of the camera (4, 4), where it is believed to have been.
        table: z of the table's plane in W, [m].

    Returns:
        (6, 240, 320).
    """
    _, height, width = SHAPE
    small = (width, height)
    if masked is not None:
        colour = np.where(masked[..., None], np.uint8(128), colour)
        depth = np.where(masked, 0.0, depth)
    heights = intrinsics.heights(depth, X_WC, table)
    known = np.isfinite(heights)
    descent = intrinsics.descents(X_WC)
    made = np.empty(SHAPE, np.float32)
    rgb = cv2.resize(colour, small, interpolation=cv2.INTER_AREA)
    made[:3] = rgb.transpose(2, 0, 1) / np.float32(127.5) - np.float32(1.0)
    for channel, image in (
        (3, np.where(known, np.clip(heights, _LOWEST, _HIGHEST) / _UNIT, 0.0)),
        (4, ~known),
        (5, np.maximum(descent, 0.0) / max(X_WC[2, 3] - table, _UNIT)),
    ):
        made[channel] = cv2.resize(image.astype(np.float32), small, interpolation=cv2.INTER_NEAREST)
    return made
