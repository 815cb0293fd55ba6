"""Whether the depth of what stands still is what it was: the camera does not move.

If most of what is seen has come nearer, or gone farther, and all of that by one law,

    z = (1 + a) z_first + b,

with a and b of one sign and but for noise, it is the depth sensor that has changed. What moves and
fills the image has another law, as a door whose hinge stays where it was.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number
from crossmodal.systems.monitoring.background import (
    LEAST_BLOCKS,
    MOST,
    block_means,
    law_of_most,
    off_the_robot,
    thinned,
)

_MEMORY = 10  # Images over which noise is averaged.
_LARGEST = 0.5  # A pixel at the edge of an object counts no more than this.


@dataclass(frozen=True, kw_only=True)
class DepthBackground(Immutable):
    """What each pixel has shown of the depth, [m].

    Attributes:
        first: Mean (H, W) of the first `_MEMORY` times; 0 where it has shown nothing yet.
        count: How many times (H, W) that is of.
        recent: Moving average (H, W) over as many.
    """

    first: Array
    count: Array
    recent: Array


def no_depth(shape: tuple[int, ...]) -> DepthBackground:
    """Before the first image."""
    zero = np.zeros(shape)
    return DepthBackground(first=zero, count=zero, recent=zero)


def averaged(background: DepthBackground, depth: Array, seen: Mask) -> DepthBackground:
    """The background with the latest depth (H, W) in its moving average, where that is `seen`."""
    share = np.where(background.recent == 0.0, 1.0, 1.0 / _MEMORY)
    change = share * (np.where(seen, depth, background.recent) - background.recent)
    return replace(background, recent=background.recent + change)


def remembered(background: DepthBackground, depth: Array, seen: Mask) -> DepthBackground:
    """The background with the depth (H, W) of a sensor that has not changed, where it is `seen`."""
    new = seen & (background.count < _MEMORY)
    count = background.count + new
    share = np.divide(1.0, count, out=np.zeros_like(count), where=new)
    first = background.first + share * (np.where(new, depth, 0.0) - background.first)
    return replace(background, first=first, count=count)


@dataclass(kw_only=True)
class DepthBackgroundConfig:
    # Share of the image of which it is known that it does not move.
    still: float = number(0.3, above=0.0, below=0.5)
    # Relative change of the depth of all the rest that is a fault. A block's noise is as large.
    tolerance: float = number(5e-4, above=0.0, at_most=1.0)


def changes(background: DepthBackground, depth: Array, seen: Mask) -> Array:
    """Mean relative change of the depth, and inverse first depth, [1/m], (N, 2).

    Of the blocks of which enough is seen.
    """
    both = seen & (background.first > 0.0)
    ratio = np.divide(depth, background.first, out=np.ones_like(depth), where=both) - 1.0
    ratio = np.clip(ratio, -_LARGEST, _LARGEST)
    inverse = np.divide(1.0, background.first, out=np.zeros_like(depth), where=both)
    return block_means([ratio, inverse], both)


def has_changed(config: DepthBackgroundConfig, change: Array) -> bool:
    """Whether so much of the image has come nearer, or gone farther, that what stands still has.

    Args:
        change: (N, 2), see `changes`.
    """
    if len(change) < LEAST_BLOCKS:
        return False
    low, high = np.quantile(change[:, 0], [config.still, 1.0 - config.still])
    if not (low > config.tolerance or high < -config.tolerance):
        return False
    change, A = change[:, 0], np.column_stack([np.ones(len(change)), change[:, 1]])
    for columns in ([0, 1], [0], [1]):
        law, _ = law_of_most(A[:, columns], change, config.tolerance)
        if np.ptp(np.sign(law)) == 0.0 and is_noise(config, change - A[:, columns] @ law):
            return True
    return False


def is_noise(config: DepthBackgroundConfig, residual: Array) -> bool:
    """Whether most residuals of a law (N,) are what neighbouring blocks do not share.

    Of normal errors within three standard deviations, 68.5 % are within one. Those of a body that
    moves change from block to block by less than they are.
    """
    sigma = max(0.25 * config.tolerance, _noise(residual))
    near = int(np.sum(np.abs(residual) < 3.0 * sigma))
    core = int(np.sum(np.abs(residual) < sigma))
    return near >= MOST * len(residual) and core > 0.685 * near - 3.0 * np.sqrt(0.216 * near)


def _noise(values: Array) -> float:
    """Standard deviation of what neighbours do not share, by second differences; robust."""
    return MEDIAN_TO_SIGMA * float(np.median(np.abs(np.diff(values, 2)))) / np.sqrt(6.0)


def watch_depth(
    config: DepthBackgroundConfig,
    background: DepthBackground | None,
    image: Array,
    robot: Array | None,
) -> tuple[DepthBackground, bool]:
    """The background after an image, and whether the depth sensor has changed.

    Args:
        background: The depth that is known, [m]; None at the first image.
        image: Depth (H, W, 1), [m]; 0, NaN or inf is no return.
        robot: Nonzero on the robot (H, W, 1), None if that is not known.
    """
    depth = thinned(image)[:, :, 0]
    seen = np.isfinite(depth) & (depth > 0.0) & off_the_robot(robot, depth.shape)
    background = averaged(background or no_depth(depth.shape), depth, seen)
    if all(has_changed(config, changes(background, of, seen)) for of in (depth, background.recent)):
        return background, True
    return remembered(background, depth, seen), False
