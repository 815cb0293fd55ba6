"""Samples of a sensor between two ticks."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array


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
