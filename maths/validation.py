"""Refuses impossible configuration values with one clear line."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np


def require(valid: bool, system: str, config: object, field: str, allowed: str) -> None:
    """Raises a ValueError that names system, field, value and what is allowed, with its unit.

    State `valid` so that NaN fails: `config.period > 0`, not `not config.period <= 0`.
    """
    if not valid:
        raise ValueError(f"{system}: {field} = {getattr(config, field)!r}, need {allowed}")


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
        valid = bool(np.isfinite(value)) and accept(value)
        require(valid, system, config, name, f"{allowed}, finite")


def require_positive(system: str, config: object, units: Mapping[str, str]) -> None:
    """Refuses the first of the fields that is not finite and above zero; unit by field."""
    for name, unit in units.items():
        require_fields(system, config, [name], f"> 0 {unit}".rstrip(), lambda value: value > 0)


def require_not_negative(system: str, config: object, units: Mapping[str, str]) -> None:
    """Refuses the first of the fields that is not finite and zero or above; unit by field."""
    for name, unit in units.items():
        require_fields(system, config, [name], f">= 0 {unit}".rstrip(), lambda value: value >= 0)


def require_vector(system: str, config: object, field: str, unit: str) -> None:
    """Refuses a config whose field is not a vector of three finite numbers."""
    value = np.asarray(getattr(config, field), dtype=float)
    finite = value.shape == (3,) and bool(np.isfinite(value).all())
    require(finite, system, config, field, f"three finite numbers, {unit}")


def require_ranges(
    system: str,
    config: object,
    *,
    positive: str = "",
    not_negative: str = "",
    counts: str = "",
    shares: str = "",
) -> None:
    """Refuses the first field that is out of its range; each argument lists fields by name.

    Args:
        system: Name of the system, and of the part of its config.
        config: Holds the fields.
        positive: Fields above zero.
        not_negative: Fields not below zero.
        counts: Fields not below one.
        shares: Fields above zero and not above one.
    """
    require_fields(system, config, positive.split(), "> 0", lambda x: x > 0)
    require_fields(system, config, not_negative.split(), ">= 0", lambda x: x >= 0)
    require_fields(system, config, counts.split(), ">= 1", lambda x: x >= 1)
    require_fields(system, config, shares.split(), "in (0, 1]", lambda x: 0 < x <= 1)
