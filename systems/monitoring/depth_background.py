"""Whether the depth of what stands still is what it was: the camera does not move.

If most of what is seen has come nearer, or gone farther, and all of that by one law,

    z = (1 + a) z_first + b,

with a and b of one sign, it is the depth sensor that has changed. Of two signs they are on a door
that fills most of the image and turns: its hinge stays where it was, and so does what is beside it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.gaussian import outlier_gate
from crossmodal.maths.validation import number
from crossmodal.systems.monitoring.background import (
    LEAST_BLOCKS,
    MOST,
    Background,
    block_means,
    law_of_most,
    off_the_robot,
    remember,
    thinned,
)

_LARGEST = 0.5  # A pixel at the edge of an object counts no more than this.
_SURE = 4.0  # Standard deviations.


@dataclass(kw_only=True)
class DepthBackgroundConfig:
    # Share of the image of which it is known that it does not move.
    still: float = number(0.3, above=0.0, below=0.5)
    # Relative change of the depth of all the rest that is a fault. A block's noise is as large.
    tolerance: float = number(5e-4, above=0.0, at_most=1.0)
    # A block's relative error in the law that most of them have changed by.
    error: float = number(2e-3, above=0.0, at_most=1.0)


def changes(background: Background, depth: Array, seen: Mask) -> Array:
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
    any_signs = change - A @ law_of_most(A, change, config.error)[0]
    sigma = 1.4826 * float(np.median(np.abs(any_signs))) + 1e-12
    for columns in ([0, 1], [0], [1]):
        law, follows = law_of_most(A[:, columns], change, config.error)
        by_law = A[:, columns] @ law
        excess = _distance(change - by_law, sigma) - _distance(any_signs, sigma)
        if np.ptp(np.sign(law)) == 0.0 and np.mean(follows) >= MOST and excess < _SURE**2:
            return not some_stay(change, by_law, sigma)
    return False


def _distance(residual: Array, sigma: float) -> float:
    """Squared distance of blocks' residuals (N,), of which few may be any number."""
    return float(np.sum(np.minimum((residual / sigma) ** 2, outlier_gate(1))))


def some_stay(change: Array, by_law: Array, sigma: float) -> bool:
    """Whether more blocks have stayed as they were than those that follow the law by their noise.

    Where no change fits a block better than the law does, the squared residual falls by
    (2 d max(n - d / 2, 0)) sigma^2, for a change by d sigma of the law and the block's noise n
    sigma.

    Args:
        change: Of the blocks (N,).
        by_law: What the law says (N,).
        sigma: Standard deviation of a block's noise.
    """
    gain = np.maximum((change - by_law) ** 2 - change**2, 0.0) / sigma**2
    d = np.abs(by_law) / sigma
    a = 0.5 * d
    mean = 2.0 * d * (norm.pdf(a) - a * norm.cdf(-a))
    square = 4.0 * d**2 * ((1.0 + a**2) * norm.cdf(-a) - a * norm.pdf(a))
    variance = float(np.sum(square - mean**2))
    return float(np.sum(gain - mean)) > _SURE * np.sqrt(variance)


def watch_depth(
    config: DepthBackgroundConfig,
    background: Background | None,
    image: Array,
    robot: Array | None,
) -> tuple[Background, bool]:
    """The background after an image, and whether the depth sensor has changed.

    Args:
        background: The depth that is known, [m]; None at the first image.
        image: Depth (H, W, 1), [m]; 0, NaN or inf is no return.
        robot: Nonzero on the robot (H, W, 1), None if that is not known.
    """
    depth = thinned(image)[:, :, 0]
    seen = np.isfinite(depth) & (depth > 0.0) & off_the_robot(robot, depth.shape)
    if background is None:
        background = Background(np.zeros_like(depth))
    if has_changed(config, changes(background, depth, seen)):
        return background, True
    return remember(background, depth, seen), False
