"""What a stream's readings are off by, once that has been measured, and is taken out of them."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import SampleWindow

OFFSET = "readings have jumped or drifted, which is taken out"
DRIFTING = "readings drift, which is taken out"
# An offset of fewer standard deviations has gone.
_GONE = 3.0


@dataclass(frozen=True, kw_only=True)
class Offsets(Immutable):
    """The constants (n,) that readings have been off by since, with variances (n,) of their own."""

    offset: Array
    variance: Array
    fault: str = ""


class OffsetModel(Protocol):
    """How the offsets of a stream are found."""

    def take_out(
        self, window: SampleWindow, before: Offsets | None, joints: SampleWindow | None
    ) -> tuple[SampleWindow, Offsets | None]:
        """The samples as they would be without their offsets, and what is to be remembered.

        Args:
            window: Samples that can be true but for an offset.
            before: What was remembered; None before the first sample.
            joints: Of the arm at the same time, if that is known.
        """
        ...


def without_gone(offset: Array, variance: Array) -> tuple[Array, Array]:
    """Offsets (..., n) and variances, both zero where readings have returned to where they were."""
    gone = np.abs(offset) <= _GONE * np.sqrt(variance)
    return np.where(gone, 0.0, offset), np.where(gone, 0.0, variance)
