"""Whether the depth of what stands still is what it was: the camera does not move.

A moving object or the robot changes the depth of a part of the image, each place by another amount.
If most of what is seen has come nearer, or gone farther, and all of that by one law,

    z = (1 + a) z_first + b,

it is the depth sensor that has changed.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from maths.arrays import Array, Mask
from maths.immutable import Immutable
from maths.validation import number

_EVERY = 4  # Of the rows and columns that are looked at; noise is correlated over some pixels.
_ROUNDS = 8
_BLOCK = 10  # Pixels of these along a block's side.
_LARGEST = 0.5  # A pixel at the edge of an object counts no more than this.


@dataclass(kw_only=True)
class DepthBackgroundConfig:
    # Share of the image of which it is known that it does not move.
    still: float = number(0.3, above=0.0, below=0.5)
    # Relative change of the depth of all the rest that is a fault. A block's noise is as large.
    tolerance: float = number(5e-4, above=0.0, at_most=1.0)
    # Share of the blocks that must have changed by one law, and a block's relative error in that.
    alike: float = number(0.5, at_least=0.5, at_most=1.0)
    error: float = number(2e-3, above=0.0, at_most=1.0)
    # Share of a block's pixels that must have been seen before and now.
    seen: float = number(0.3, above=0.0, at_most=1.0)
    # Fewer blocks tell nothing.
    blocks: int = number(20, at_least=2, at_most=10**6)


@dataclass(frozen=True)
class DepthBackground(Immutable):
    """The depth that each pixel (H, W) showed first, [m]; 0 where there was none yet."""

    first: Array


def thinned(image: Array) -> Array:
    """The pixels (H, W) of an image (H', W', 1) that are looked at, whole blocks of them."""
    few = image[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY, 0]
    height, width = (_BLOCK * (size // _BLOCK) for size in few.shape)
    return few[:height, :width]


def visible(depth: Array, robot: Array | None) -> Mask:
    """Where there is a depth (H, W), and no robot in its surroundings."""
    seen = np.isfinite(depth) & (depth > 0.0)
    if robot is not None and depth.size:
        border = cv2.dilate(np.ascontiguousarray(robot), np.ones((5, 5), np.uint8))
        seen &= border == 0
    return seen


def changes(background: DepthBackground, depth: Array, seen: Mask, share: float) -> Array:
    """Mean relative change of the depth, and inverse first depth, [1/m], (N, 2).

    Of the blocks of which enough is seen.
    """
    both = seen & (background.first > 0.0)
    ratio = np.divide(depth, background.first, out=np.ones_like(depth), where=both) - 1.0
    ratio = np.clip(ratio, -_LARGEST, _LARGEST)

    def by_block(values: Array | Mask) -> Array:
        height, width = (size // _BLOCK for size in values.shape)
        blocks = values.reshape(height, _BLOCK, width, _BLOCK)
        return np.asarray(blocks.sum(axis=(1, 3), dtype=float)).ravel()

    count = by_block(both)
    enough = count >= share * _BLOCK**2
    inverse = np.divide(1.0, background.first, out=np.zeros_like(depth), where=both)
    return np.column_stack([by_block(ratio), by_block(inverse)])[enough] / count[enough, None]


def follows_one_law(change: Array, error: float) -> Mask:
    """Which blocks change by a + b / z_first, with a and b those of most of them.

    Args:
        change: (N, 2), see `changes`.
        error: Of one block.
    """
    A = np.column_stack([np.ones(len(change)), change[:, 1]])
    weights = np.ones(len(change))
    for _ in range(_ROUNDS):  # The sum of absolute residuals, by weighted squares.
        root = np.sqrt(weights)
        law = np.linalg.lstsq(A * root[:, None], change[:, 0] * root, rcond=None)[0]
        residual = np.abs(change[:, 0] - A @ law)
        weights = 1.0 / np.maximum(residual, error)
    return np.asarray(residual < error)


def has_changed(config: DepthBackgroundConfig, change: Array) -> bool:
    """Whether so much of the image has come nearer, or gone farther, that what stands still has.

    Args:
        change: (N, 2), see `changes`.
    """
    if len(change) < config.blocks:
        return False
    low, high = np.quantile(change[:, 0], [config.still, 1.0 - config.still])
    if not (low > config.tolerance or high < -config.tolerance):
        return False
    return bool(np.mean(follows_one_law(change, config.error)) >= config.alike)


def watch_depth(
    config: DepthBackgroundConfig,
    background: DepthBackground | None,
    image: Array,
    robot: Array | None,
) -> tuple[DepthBackground, bool]:
    """The background after an image, and whether the depth sensor has changed.

    Args:
        background: What is known; None at the first image.
        image: Depth (H, W, 1), [m]; 0, NaN or inf is no return.
        robot: Nonzero on the robot (H, W, 1), None if that is not known.
    """
    depth = thinned(image)
    seen = visible(depth, None if robot is None else thinned(robot))
    if background is None:
        background = DepthBackground(np.zeros_like(depth))
    if has_changed(config, changes(background, depth, seen, config.seen)):
        return background, True
    new = seen & (background.first == 0.0)
    if not new.any():
        return background, False
    return DepthBackground(np.where(new, depth, background.first)), False
