"""Whether the grey of what stands still is what it was, but for the light: the camera stands still.

Another exposure, or another light, multiplies what a camera collects, and with its gamma curve the
grey values, too: black stays black. If most of what is seen has changed by one law,

    grey = (1 + b) grey_first + a,

and this needs the offset a, it is the camera that has changed.
"""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
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

_WHITE = 255.0


@dataclass(kw_only=True)
class BlackLevelConfig:
    # Offset that is a fault.
    tolerance: float = number(4.0, above=0.0, at_most=255.0, unit="of 255")
    # A block's error in the law that most of them have changed by.
    error: float = number(1.5, above=0.0, at_most=255.0, unit="of 255")
    # Of those, share that another exposure explains, at most.
    exposed: float = number(0.75, above=0.0, at_most=1.0)
    # By so much the contrast may have changed; beyond, noise that is clipped at black looks like an
    # offset.
    contrast: float = number(2.0, above=1.0, at_most=255.0)


@dataclass(frozen=True, kw_only=True)
class GreyLaw(Immutable):
    """How what stands still has changed: grey = gain grey_first + offset, of 255."""

    gain: float = 1.0
    offset: float = 0.0


def law_of_grey(config: BlackLevelConfig, change: Array, first: Array) -> GreyLaw:
    """The law that most blocks follow; that of no change where there is none.

    Args:
        change: Of the blocks' grey (N,).
        first: Their grey before (N,).
    """
    if len(change) < LEAST_BLOCKS:
        return GreyLaw()
    (b,), exposed = law_of_most(first[:, None], change, config.error)
    exposure = GreyLaw(gain=1.0 + b) if exposed.mean() >= MOST else GreyLaw()
    A = np.column_stack([np.ones(len(change)), first])
    (a, b), follows = law_of_most(A, change, config.error)
    if follows.mean() < MOST or exposed.sum() > config.exposed * follows.sum():
        return exposure
    if abs(a) < config.tolerance or not 1.0 / config.contrast < 1.0 + b < config.contrast:
        return exposure
    return GreyLaw(gain=1.0 + b, offset=float(a))


def watch_grey(
    config: BlackLevelConfig,
    background: Background | None,
    image: Array,
    robot: Array | None,
) -> tuple[Background, float]:
    """The background after an image, and the offset of its grey, of 255.

    Args:
        background: The grey that is known, at the first image's exposure; None at the first image.
        image: Colours (H, W, 4), of 255; what is black or white may be darker or brighter.
        robot: Nonzero on the robot (H, W, 1), None if that is not known.
    """
    red, green, blue = np.moveaxis(thinned(image)[:, :, :3], 2, 0)
    grey = (red.astype(float) + green + blue) / 3.0
    seen = (np.minimum(np.minimum(red, green), blue) > 0) & (
        np.maximum(np.maximum(red, green), blue) < _WHITE
    )
    seen &= off_the_robot(robot, grey.shape)
    if background is None:
        background = Background(np.zeros_like(grey))
    both = seen & (background.first > 0.0)
    blocks = block_means([grey - background.first, background.first], both)
    law = law_of_grey(config, blocks[:, 0], blocks[:, 1])
    if law.offset:
        return background, law.offset
    return remember(background, grey / law.gain, seen), 0.0
