"""Samples of a sensor between two ticks."""

from dataclasses import dataclass

from maths.arrays import Array


@dataclass(kw_only=True)
class SampleWindow:
    """The samples of one sensor since the last tick.

    Attributes:
        times: Stamps (K,), increasing, [s].
        values: Samples (K, n), in the sensor's unit.
    """

    times: Array
    values: Array
