"""Numbers with a unit in a scenario: `5 cm` where a field is in metres."""

import copy
import dataclasses
import re
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, is_number
from crossmodal.maths.units import in_unit
from crossmodal.maths.validation import declared

_NUMBER = r"[-+]?(?:\d{1,20}\.?\d{0,20}|\.\d{1,20})(?:[eE][-+]?\d{1,3})?"
_MEASURE = re.compile(rf"\s*({_NUMBER})\s*((?:1/)?[A-Za-z].{{0,30}})")


@dataclass(frozen=True, kw_only=True)
class _Measure:
    """A text that says a number and its unit, and where it stands."""

    holder: Any
    key: Any
    path: str
    value: float
    unit: str
    wanted: str  # The field's unit.

    def number(self, source: str, wanted: str) -> float:
        try:
            return in_unit(self.value, self.unit, wanted)
        except (ValueError, OverflowError):
            need = f"in {wanted}" if wanted else "a number without a unit"
            raise ScenarioError(
                f"{source}: {self.path} = {self.holder[self.key]!r}, but it must be {need}"
            ) from None


def without_units(document: dict[str, Any], schema: type, source: str) -> dict[str, Any]:
    """The document with each text such as `5 cm` as the number in the unit of its field.

    Args:
        document: As it was read; left as it is.
        schema: The dataclass that it is to become.
        source: Where it comes from, the beginning of an error message.

    Raises:
        ScenarioError: for a unit that does not measure what the field's does.
    """
    plain = copy.deepcopy(document)
    for found in list(_measures(plain, schema)):
        number = found.number(source, found.wanted)
        found.holder[found.key] = int(number) if number.is_integer() else number
    return plain


def check_units(
    document: dict[str, Any], schema: type, source: str, units: Callable[[], Mapping[str, str]]
) -> None:
    """Refuses a unit that would do for its field, but not in this scenario.

    Args:
        document: As it was read.
        schema: The dataclass that it has become.
        source: Where it comes from.
        units: Gives the units, by path, of fields that leave them open (`m or rad`).

    Raises:
        ScenarioError: naming the first such value and the unit wanted.
    """
    left_open = [found for found in _measures(document, schema) if " or " in found.wanted]
    known = units() if left_open else {}
    for found in left_open:
        found.number(source, known.get(found.path, found.wanted))


def _measures(document: dict[str, Any], schema: type) -> Iterator[_Measure]:
    hints = typing.get_type_hints(schema)
    for field in dataclasses.fields(schema):
        if field.name in document:
            possible = declared(field)
            unit = possible.unit if possible else ""
            yield from _below(document, field.name, hints[field.name], unit, field.name)


def _below(holder: Any, key: Any, schema: Any, unit: str, path: str) -> Iterator[_Measure]:
    value = holder[key]
    origin, arguments = typing.get_origin(schema), typing.get_args(schema)
    if type(None) in arguments:
        (schema,) = (choice for choice in arguments if choice is not type(None))
        yield from _below(holder, key, schema, unit, path)
    elif dataclasses.is_dataclass(schema) and isinstance(value, dict):
        for found in _measures(value, typing.cast(type, schema)):
            yield dataclasses.replace(found, path=f"{path}.{found.path}")
    elif isinstance(value, list) and (origin or schema) in (list, np.ndarray):
        for index in range(len(value)):
            item = arguments[0] if origin is list else schema
            yield from _below(value, index, item, unit, f"{path}.{index}")
    elif isinstance(value, dict) and origin is dict:
        for name in value:
            yield from _below(value, name, arguments[1], unit, f"{path}.{name}")
    elif (origin or schema) in (int, float, np.ndarray) and (said := _said(value)):
        number, own = said.groups()
        yield _Measure(
            holder=holder, key=key, path=path, value=float(number), unit=own, wanted=unit
        )


def _said(value: Any) -> re.Match[str] | None:
    """The number and the unit of a text that says both."""
    is_text = isinstance(value, str) and not is_number(value)
    return _MEASURE.fullmatch(value) if is_text else None
