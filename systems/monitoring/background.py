"""What a camera that does not move shows of what stands still, compared block by block with before.

A moving object or the robot changes a part of the image, each place in another way. If most of what
is seen has changed by one law, it is the sensor that has.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable

_EVERY = 4  # Of the rows and columns that are looked at; noise is correlated over some pixels.
_ROUNDS = 8
_BLOCK = 10  # Pixels of these along a block's side.
_SEEN = 0.3  # Share of a block's pixels that must have been seen before and now.
# A law needs so many blocks, and so large a share of them must have changed by it.
LEAST_BLOCKS, MOST = 20, 0.5


@dataclass(frozen=True)
class Background(Immutable):
    """What each pixel (H, W) showed first, above zero; 0 where it has shown nothing yet."""

    first: Array


def thinned(image: Array) -> Array:
    """The pixels (H, W, C) of an image (H', W', C) that are looked at, whole blocks of them."""
    few = image[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    height, width = (_BLOCK * (size // _BLOCK) for size in few.shape[:2])
    return few[:height, :width]


def off_the_robot(robot: Array | None, shape: tuple[int, ...]) -> Mask:
    """Where the robot is not, nor near (H, W).

    Args:
        robot: Nonzero on the robot (H', W', 1), None if that is not known.
        shape: (H, W) of a thinned image.
    """
    if robot is None or not np.prod(shape):
        return np.ones(shape, bool)
    here = np.ascontiguousarray(thinned(robot)[:, :, 0])
    return np.asarray(cv2.dilate(here, np.ones((5, 5), np.uint8)) == 0)


def block_means(values: list[Array], where: Mask, share: float = _SEEN) -> Array:
    """Means of values (H, W) over the blocks of which a share is `where` (H, W); (N, values)."""

    def by_block(image: Array | Mask) -> Array:
        height, width = (size // _BLOCK for size in image.shape)
        blocks = image.reshape(height, _BLOCK, width, _BLOCK)
        return np.asarray(blocks.sum(axis=(1, 3), dtype=float)).ravel()

    count = by_block(where)
    enough = count >= share * _BLOCK**2
    sums = np.column_stack([by_block(np.where(where, value, 0.0)) for value in values])
    return sums[enough] / count[enough, None]


def law_of_most(A: Array, change: Array, error: float) -> tuple[Array, Mask]:
    """The law (m,) of change = A law that most blocks have, and which (N,) follow it.

    Args:
        A: (N, m)
        change: Of the blocks (N,).
        error: Of one block's change.
    """
    law = np.zeros(A.shape[1])
    weights = np.ones(len(change))
    for _ in range(_ROUNDS):  # The sum of absolute residuals, by weighted squares.
        root = np.sqrt(weights)
        law = np.asarray(np.linalg.lstsq(A * root[:, None], change * root, rcond=None)[0])
        weights = 1.0 / np.maximum(np.abs(change - A @ law), error)
    return law, np.asarray(np.abs(change - A @ law) < error)


def remember(background: Background, image: Array, seen: Mask) -> Background:
    """The background with the places of an image (H, W) that show something for the first time."""
    new = seen & (background.first == 0.0)
    return Background(np.where(new, image, background.first)) if new.any() else background
