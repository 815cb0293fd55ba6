"""Validation of configuration values."""

from collections.abc import Callable, Sequence

import numpy as np


def require_fields(
    system: str,
    config: object,
    fields: Sequence[str],
    allowed: str,
    accept: Callable[[float], bool],
) -> None:
    """Refuses the first of the fields whose value is not finite or not accepted."""
    for name in fields:
        value = getattr(config, name)
        if not (np.isfinite(value) and accept(value)):
            raise ValueError(f"{system}: {name} is {value!r}; allowed is {allowed}, finite")
