"""Configurations say at each number which values are possible, and one checker refuses the rest.

A field is declared by `number` or `numbers`, which give it a default and a range with two ends:

    speed: float = number(0.02, above=0.0, at_most=10.0, unit="m/s")

`check` walks a configuration with all that is below it. Relations between fields stay with
whoever needs them, as calls of `require`.
"""

import copy
import operator
import sys
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, is_dataclass
from functools import reduce
from math import inf, isfinite
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

_KEY = "possible"
_COMPARE = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le}


@dataclass(frozen=True, kw_only=True)
class Range:
    """Which values a number may have, or each number of a list, vector or mapping.

    Attributes:
        ends: Comparison and bound at the lower and at the upper end; the bounds are finite.
        unit: Of the bounds and the values.
        infinite: Whether infinity is possible too.
        shape: How many numbers there are along each axis, exactly or one of a range; empty for a
            single number, None for any.
    """

    ends: tuple[tuple[str, float], tuple[str, float]]
    unit: str = ""
    infinite: bool = False
    shape: tuple[int | range, ...] | None = ()

    def holds(self, value: Any) -> bool:
        """Whether a number is in the range, or an array has the shape and all of it is."""
        return self._fits(np.shape(value)) and all(map(self._contains, np.ravel(value).tolist()))

    def _fits(self, shape: tuple[int, ...]) -> bool:
        if self.shape is None:
            return True
        return len(shape) == len(self.shape) and all(
            size in wanted if isinstance(wanted, range) else size == wanted
            for size, wanted in zip(shape, self.shape, strict=True)
        )

    def _contains(self, value: float) -> bool:
        if value == inf:
            return self.infinite
        return all(_COMPARE[symbol](value, bound) for symbol, bound in self.ends)

    def __str__(self) -> str:
        ends = ", ".join(f"{symbol} {bound:g}" for symbol, bound in self.ends)
        text = f"{ends} {self.unit}".rstrip() + ", or infinite" * self.infinite
        if not self.shape:
            return text
        sizes = [
            f"{size[0]} to {size[-1]}" if isinstance(size, range) else str(size)
            for size in self.shape
        ]
        return f"{' x '.join(sizes)} numbers, each {text}"


_LARGEST = sys.float_info.max
_FINITE = Range(ends=((">=", -_LARGEST), ("<=", _LARGEST)), shape=None)


def number(
    default: T,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    unit: str = "",
    infinite: bool = False,
) -> T:
    """A field that holds one number, or None where its type has it.

    Args:
        default: Its default.
        above: Lower end, itself impossible; either this or `at_least`.
        at_least: Lower end, itself possible.
        below: Upper end, itself impossible; either this or `at_most`.
        at_most: Upper end, itself possible.
        unit: Of the number.
        infinite: Whether infinity is possible beyond the upper end, because it means something.

    Raises:
        TypeError: where an end is not given, is given twice or is not finite.
    """
    ends = (_end({">": above, ">=": at_least}), _end({"<": below, "<=": at_most}))
    return field(default=default, metadata={_KEY: Range(ends=ends, unit=unit, infinite=infinite)})


def numbers(
    default: T,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    unit: str = "",
    shape: tuple[int | range, ...] | None = None,
) -> T:
    """A field that holds a list, an array or a mapping of numbers, each in the same range.

    Args:
        default: Its default, which is copied.
        above: As for `number`, as are the other ends and the unit.
        at_least: Lower end, itself possible.
        below: Upper end, itself impossible.
        at_most: Upper end, itself possible.
        unit: Of each number.
        shape: How many there are along each axis, exactly or one of a range; the default's
            where it is not given.

    Raises:
        TypeError: where an end is not given, is given twice or is not finite.
    """
    ends = (_end({">": above, ">=": at_least}), _end({"<": below, "<=": at_most}))
    shape = np.asarray(default).shape if shape is None else shape
    return field(
        default_factory=lambda: copy.copy(default),
        metadata={_KEY: Range(ends=ends, unit=unit, shape=shape)},
    )


def _end(given: Mapping[str, float | None]) -> tuple[str, float]:
    said = [(symbol, bound) for symbol, bound in given.items() if bound is not None]
    if len(said) != 1 or not isfinite(said[0][1]):
        raise TypeError(f"a range has one finite end of {' or '.join(given)}, not {said}")
    return said[0]


def declared(item: "Field[Any]") -> Range | None:
    """What `number` or `numbers` said of a dataclass's field; None for any other field."""
    return item.metadata.get(_KEY)


def check(config: object, name: str) -> None:
    """Refuses a configuration in which a number is impossible, here or anywhere below.

    What is below are the dataclasses among its fields, also in lists, mappings and optional ones. A
    number of which nothing is declared must be finite.

    Args:
        config: A dataclass.
        name: Of the system, or of the file: the beginning of the message.

    Raises:
        ValueError: in one line with the path of the first such number, its value and unit, and what
            is possible.
    """
    for path, value, possible in _values(config, "", _FINITE):
        if not possible.holds(value):
            need = "a finite number" if possible is _FINITE else str(possible)
            raise ValueError(_refusal(name, path, value, possible.unit, need))


def _values(part: Any, path: str, possible: Range) -> Iterator[tuple[str, Any, Range]]:
    """The numbers and arrays of numbers from `part` on, each with its path and its range."""
    if is_dataclass(part):
        for item in fields(part):
            below = declared(item) or _FINITE
            yield from _values(getattr(part, item.name), f"{path}.{item.name}", below)
    elif isinstance(part, Mapping):
        for key, value in part.items():
            yield from _values(value, f"{path}.{key}", possible)
    elif isinstance(part, list) and not possible.shape:
        for index, value in enumerate(part):
            yield from _values(value, f"{path}.{index}", possible)
    elif isinstance(part, int | float | list | np.number | np.ndarray):
        yield path.removeprefix("."), part, possible


def require(valid: bool, system: str, config: object, field: str, allowed: str) -> None:
    """Raises a ValueError that names system, field, value, unit and what is allowed.

    For what is impossible only beside other fields: `check` has refused all else, and NaN.

    Args:
        valid: Whether the value is possible.
        system: Name of the system.
        config: Of the system.
        field: The field's name; a path `part.field` for one of a part's.
        allowed: What is possible.
    """
    if not valid:
        *parts, name = field.split(".")
        owner: Any = reduce(getattr, parts, config)
        units = {item.name: found.unit for item in fields(owner) if (found := declared(item))}
        value = getattr(owner, name)
        raise ValueError(_refusal(system, field, value, units.get(name, ""), allowed))


def _refusal(name: str, path: str, value: Any, unit: str, need: str) -> str:
    plain = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
    return f"{name}: {path} = {plain!r} {unit}".rstrip() + f", need {need}"
