"""Every number in every scenario declares which values are possible, and no other is loaded."""

import typing
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crossmodal.diagrams.applications import OWN, applications
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.run.scenario import parse_scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths.validation import declared, number

OWN_APPLICATIONS = ("pendulum/pendulum.py", "two_arms/two_arms.py")
ELEMENT = 0  # In a path: of a list. Keys of mappings and names of fields are text.
Path_ = tuple[str | int, ...]


def numeric_fields(schema: Any, path: Path_ = ()) -> Iterator[tuple[Path_, "Field[Any]"]]:
    """The fields of numbers in a dataclass and all dataclasses below it, each with its path."""
    hints = typing.get_type_hints(schema)
    for item in fields(schema):
        for below, kind in leaves(hints[item.name], (*path, item.name)):
            if is_dataclass(kind):
                yield from numeric_fields(kind, below)
            elif kind in (int, float, np.ndarray):
                yield (*path, item.name), item


def leaves(hint: Any, path: Path_) -> Iterator[tuple[Path_, Any]]:
    """What an optional value, a list or a mapping holds; any other type is its own leaf."""
    arguments = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if origin is np.ndarray or not arguments:
        yield path, origin or hint
    elif origin is list:
        yield from leaves(arguments[0], (*path, ELEMENT))
    elif origin is dict:
        yield from leaves(arguments[1], (*path, "part"))
    else:
        for argument in arguments:
            yield from leaves(argument, path)


def forgotten(schema: Any) -> list[str]:
    return [
        ".".join(map(str, path)) for path, item in numeric_fields(schema) if declared(item) is None
    ]


@dataclass
class Inner:
    said: float = number(0.0, at_least=0.0, at_most=1.0)
    speed: float = 0.0


@dataclass
class Outer:
    name: str = ""
    loud: bool = False
    count: int = 0
    goal: float | None = None
    gains: list[float] = field(default_factory=list)
    place: np.ndarray = field(default_factory=lambda: np.zeros(3))
    limits: dict[str, float] = field(default_factory=dict)
    inner: Inner = field(default_factory=Inner)
    spare: Inner | None = None
    many: dict[str, list[Inner]] = field(default_factory=dict)


def test_a_number_without_a_range_is_found_wherever_it_is() -> None:
    assert forgotten(Outer) == [
        "count",
        "goal",
        "gains",
        "place",
        "limits",
        "inner.speed",
        "spare.speed",
        "many.part.0.speed",
    ]


def test_every_number_of_every_application_s_scenario_declares_its_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    here = Path(__file__).parent
    monkeypatch.setenv(OWN, ",".join(str(here / file) for file in OWN_APPLICATIONS))
    known = applications()
    assert {"crossmodal", "pendulum", "two-arms"} <= set(known)
    for application in known.values():
        assert len(list(numeric_fields(application.scenario))) > 30
        assert forgotten(application.scenario) == []


def altered(item: "Field[Any]", value: float) -> Any:
    """The value in the place of a field's number, or of the first of its numbers."""
    if item.default_factory is MISSING:
        return value
    return [value, *np.asarray(item.default_factory()).tolist()[1:]]


def document(path: Path_, value: Any) -> dict[str, Any]:
    for step in reversed(path):
        value = [value] if step == ELEMENT else {step: value}
    return value


def value_at(config: Any, path: Path_) -> Any:
    for step in path:
        config = getattr(config, step) if is_dataclass(config) else config[step]  # type: ignore
    return config


def loaded(path: Path_, value: Any) -> Scenario | str:
    """The scenario that says only this, or why it is refused."""
    try:
        return parse_scenario(Scenario, document(path, value), Path("a.yaml"))
    except ScenarioError as error:
        return str(error)


def test_perception_has_few_numbers_of_its_own() -> None:
    numbers = [path for path, _ in numeric_fields(Scenario) if path[0] == "perception"]
    assert len(numbers) <= 220, len(numbers)


@pytest.mark.parametrize("value", [nan, inf, -inf, -1, 0, 1e300])
def test_any_value_of_any_number_is_refused_by_its_path_or_in_its_range(value: float) -> None:
    accepted = []
    for path, item in numeric_fields(Scenario):
        result, possible = loaded(path, altered(item, value)), declared(item)
        assert possible is not None
        if isinstance(result, str):
            assert result.startswith(f"a.yaml: {'.'.join(map(str, path))}")
            assert "\n" not in result
        else:
            assert possible.holds(value_at(result, path))
            accepted.append(path[-1])
    if not np.isfinite(value):
        endless = ["end"] * 5
        endless += ["explore_time_limit", "lead", "slip", "stuck_after", "stuck_time", "travel"]
        assert sorted(map(str, accepted)) == (sorted(endless) if value == inf else [])
