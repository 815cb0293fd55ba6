"""Images of a camera with their stamps."""

from dataclasses import dataclass
from typing import Any

from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class StampedImage(Immutable):
    """What a camera delivered last.

    Attributes:
        time: When it was taken by the camera's stamp, [s]; a latency that nobody knows of is not
            in it.
        image: `ImageRgba8U` or `ImageDepth32F`, [m].
    """

    time: float
    image: Any


def copied(image: Any) -> Any:
    """An image of its own: Drake writes an image port's next value over the last one."""
    other = type(image)(image.width(), image.height())
    other.mutable_data[:] = image.data
    return other
