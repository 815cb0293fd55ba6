"""Makes config dataclasses of plain values and says in one line what is wrong with them."""

import contextlib
import dataclasses
import difflib
import re
import reprlib
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from crossmodal.maths.units import in_unit
from crossmodal.maths.validation import declared

T = TypeVar("T")
_SHOWN = reprlib.Repr()  # How a value stands in a message.
_SHOWN.maxstring = _SHOWN.maxother = 100
_MEASURE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?:1/)?[A-Za-z].*)")


class ScenarioError(Exception):
    """What a user gave cannot be run; the message is one line that says what to change."""

    def __init__(self, message: str) -> None:
        super().__init__("".join(c if c.isprintable() else " " for c in message))


def one_line(error: BaseException | str) -> str:
    """The message on one line, without runs of blanks."""
    return " ".join(str(error).split())


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """Says which of `allowed` was probably meant, and lists them all."""
    names = sorted(allowed)
    near = difflib.get_close_matches(word, names, n=3, cutoff=0.5)
    near += [name for name in names if word and name.startswith(word)]
    near.sort(key=lambda name: name.split("_")[0] != word.split("_")[0])  # depth_, pressure_, ...
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"{hint}allowed: {', '.join(names) or 'none'}"


def load_typed(
    schema: type[T],
    document: Mapping[str, Any],
    source: str,
    units: Callable[[], Mapping[str, str]] = dict,
) -> T:
    """The mapping as an instance of the dataclass `schema`; absent keys keep their defaults.

    Of a mapping of names to parts, such as the cameras, those parts are there that the document
    names; one that is also among the defaults keeps its values. A number may be a text with a unit,
    such as `5 cm`, which becomes the number in the unit that its field declares.

    Args:
        schema: Its fields are numbers, texts, arrays, dataclasses, lists and mappings of these.
        document: As it was read.
        source: Where it comes from, the beginning of every error message.
        units: Gives the units, by path, of fields that leave them open (`m or rad`).

    Raises:
        ScenarioError: for an unknown key, a value of another type, or a unit that does not measure
            what the field's does.
    """
    made: T = _Reader(source, units).part(document, schema, schema(), "")
    return made


@dataclass(frozen=True)
class _Reader:
    source: str
    units: Callable[[], Mapping[str, str]]

    def part(self, value: Any, schema: Any, default: Any, path: str) -> Any:
        """The mapping `value` as an instance of the dataclass `schema`."""
        fields = {field.name: field for field in dataclasses.fields(schema)}
        keys = f"a mapping of some of these keys: {', '.join(sorted(fields))}"
        self._require(isinstance(value, dict), value, keys, path)
        hints = typing.get_type_hints(schema)
        made = {}
        for key, item in value.items():
            where = f"{path}.{key}".lstrip(".")
            if key not in fields:
                hint = suggestion(str(key), fields)
                raise ScenarioError(f"{self.source}: unknown key '{where}'; {hint}")
            possible = declared(fields[key])
            unit = possible.unit if possible else ""
            made[key] = self.value(item, hints[key], getattr(default, key), where, unit)
        return dataclasses.replace(default, **made)

    def value(self, value: Any, schema: Any, default: Any, path: str, unit: str) -> Any:
        origin, arguments = typing.get_origin(schema), typing.get_args(schema)
        kind = origin or schema
        if kind in (typing.Union, types.UnionType):
            if value is None:
                return None
            (schema,) = (choice for choice in arguments if choice is not type(None))
            return self.value(value, schema, default, path, unit)
        if dataclasses.is_dataclass(kind):
            default = default if isinstance(default, typing.cast(type, kind)) else schema()
            return self.part(value, schema, default, path)
        if kind is list:
            self._require(isinstance(value, list), value, "a list", path)
            return [
                self.value(item, arguments[0], None, f"{path}.{index}", unit)
                for index, item in enumerate(value)
            ]
        if kind is dict:
            self._require(isinstance(value, dict), value, "a mapping", path)
            self._require(all(isinstance(key, str) for key in value), value, "keyed by text", path)
            return {
                key: self.value(item, arguments[1], (default or {}).get(key), f"{path}.{key}", unit)
                for key, item in value.items()
            }
        if kind is np.ndarray:
            self._require(isinstance(value, list), value, "numbers in a list", path)
            try:
                return np.array(self._numbers(value, path, unit), dtype=float)
            except ValueError:  # Rows of different lengths.
                raise self._refusal(value, "numbers in a list", path) from None
        if kind is float:
            return self._number(value, "a number", path, unit)
        if kind is int:
            whole = "a whole number"
            number = value if type(value) is int else self._number(value, whole, path, unit)
            self._require(isinstance(number, int) or number.is_integer(), number, whole, path)
            return int(number)
        expected = "true or false" if kind is bool else "text"
        self._require(isinstance(value, kind), value, expected, path)
        return value

    def _numbers(self, value: Any, path: str, unit: str) -> Any:
        if not isinstance(value, list):
            return self._number(value, "a number", path, unit)
        return [self._numbers(item, f"{path}.{index}", unit) for index, item in enumerate(value)]

    def _number(self, value: Any, expected: str, path: str, unit: str) -> float:
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            if not isinstance(value, bool):
                return float(value)  # Also of a text: YAML 1.1 reads 1e-3 as one.
        measure = _MEASURE.fullmatch(value) if isinstance(value, str) else None
        if measure is None:
            raise self._refusal(value, expected, path)
        wanted = self.units().get(path, unit) if " or " in unit else unit
        try:
            return in_unit(float(measure[1]), measure[2], wanted)
        except (ValueError, OverflowError):
            need = f"in {wanted}" if wanted else "a number without a unit"
            raise self._refusal(value, need, path) from None

    def _require(self, condition: bool, value: Any, expected: str, path: str) -> None:
        if not condition:
            raise self._refusal(value, expected, path)

    def _refusal(self, value: Any, expected: str, path: str) -> ScenarioError:
        shown = _SHOWN.repr(value)
        where = path or "the document"
        return ScenarioError(f"{self.source}: {where} = {shown}, but it must be {expected}")
