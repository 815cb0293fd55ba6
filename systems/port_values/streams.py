"""What sensors deliver: samples, images with their stamps, and how far a stream can be trusted."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from crossmodal.maths.arrays import Array, unknown
from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class StampedImage(Immutable):
    """What a camera delivered last, and where the camera is believed to have been at the stamp.

    Attributes:
        time: When it was taken by the camera's stamp, [s]; a latency that nobody knows of is not
            in it.
        image: `ImageRgba8U` or `ImageDepth32F`, [m].
        X_WC: Pose of the camera C (4, 4); x right, y down, z forward. NaN if nobody knows it.
        covariance: (6, 6) of xi in X_WC exp(xi), rotation first, [rad, m]; NaN likewise.
    """

    time: float
    image: Any
    X_WC: Array = unknown(4, 4)
    covariance: Array = unknown(6, 6)


def copied(image: Any) -> Any:
    """An image of its own: Drake writes an image port's next value over the last one."""
    other = type(image)(image.width(), image.height())
    other.mutable_data[:] = image.data
    return other


@dataclass(kw_only=True)
class SampleWindow:
    """The samples of one sensor since the last tick.

    Attributes:
        times: Stamps (K,), increasing, [s].
        values: Samples (K, n), in the sensor's unit.
        variances: Of an error (n,) that all samples have in common, beyond that of the sensor: what
            is left of an offset that was taken out; (1,) zero where there was none.
    """

    times: Array
    values: Array
    variances: Array = field(default_factory=lambda: np.zeros(1))


def no_samples(size: int) -> SampleWindow:
    """A window without a sample of so many values."""
    return SampleWindow(times=np.zeros(0), values=np.zeros((0, size)))


@dataclass(frozen=True, kw_only=True)
class StreamHealth(Immutable):
    """What a monitor makes of a stream.

    Attributes:
        age: Of the last reading that was passed on, [s].
        fault: What is wrong with the stream, in words; empty while nothing is.
    """

    age: float = 0.0
    fault: str = ""


HEALTHY = StreamHealth()
