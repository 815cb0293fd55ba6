"""The array types that annotations use, and a field of what may not be known."""

from dataclasses import field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


def unknown(*shape: int) -> Any:
    """A dataclass's field that is an array of NaN where nothing else is said."""
    return field(default_factory=lambda: np.full(shape, np.nan))
