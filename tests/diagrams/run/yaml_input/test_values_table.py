"""A scenario's values with what they may be and what they mean."""

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, cast, get_args, get_type_hints

import numpy as np
import pytest

from crossmodal.diagrams.applications import applications, load_scenario
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.run.yaml_input.values_table import comments, unit_at, values_table
from crossmodal.maths.validation import number, numbers


@dataclass(kw_only=True)
class Wheel:
    """A wheel.

    Attributes:
        spokes: How many, and
            of what.
        radius: Not what the comment says.
    """

    spokes: int = 3
    radius: float = number(0.3, above=0.0, at_most=2.0, unit="m")  # Of the rim.
    # Where its axle is,
    # in the car's frame.
    centre: np.ndarray = numbers(np.zeros(2), at_least=-1.0, at_most=1.0, unit="m")
    plain: str = ""


@dataclass(kw_only=True)
class Car:
    wheels: dict[str, Wheel] = field(default_factory=lambda: {"left": Wheel()})  # By name.
    spare: Wheel = field(default_factory=Wheel)


@dataclass(kw_only=True)
class Train:
    cars: list[Wheel] = field(default_factory=list)  # In their order.


@dataclass(kw_only=True)
class Trailer:
    wheel: Wheel | None = None


def test_each_value_has_its_range_and_the_comment_at_its_declaration() -> None:
    lines = {line.key: line for line in values_table(Car())}
    names = ("spokes", "radius", "centre", "plain")
    assert list(lines) == [f"{at}.{name}" for at in ("wheels.left", "spare") for name in names]
    assert lines["spare.radius"].possible == "> 0, <= 2 m"
    assert lines["spare.radius"].meaning == "Of the rim."
    assert lines["spare.spokes"].meaning == "How many, and of what."
    assert lines["spare.centre"].meaning == "Where its axle is, in the car's frame."
    assert (lines["spare.centre"].value, lines["spare.plain"].value) == ("[0, 0]", "''")
    assert lines["spare.plain"].meaning == ""


def test_one_value_or_a_part_can_be_asked_for() -> None:
    assert [line.key for line in values_table(Car(), "wheels.left.radius")] == [
        "wheels.left.radius"
    ]
    assert len(values_table(Car(), "wheels")) == 4


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("whels", r"unknown key 'whels'; did you mean 'wheels'"),
        ("wheels.right", r"there is no 'right' in 'wheels'; allowed: left"),
        ("spare.radius.more", r"there is no 'more' in 'spare.radius'; allowed: none"),
    ],
)
def test_an_unknown_key_says_what_there_is(key: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        values_table(Car(), key)


def test_the_items_of_a_list_are_explained_also_where_it_is_empty() -> None:
    train = Train(cars=[Wheel(spokes=5)])
    lines = {line.key: line for line in values_table(train)}
    assert lines["cars.0.spokes"].value == "5"
    assert lines["cars.0.radius"].possible == "> 0, <= 2 m"
    assert [line.value for line in values_table(Train())] == ["[]"]
    first, *items = values_table(Train(), "cars")
    assert (first.key, first.value, first.meaning) == ("cars", "[]", "In their order.")
    assert items == values_table(Train(), "cars.0")
    assert (items[0].key, items[0].value) == ("cars.0.spokes", "3 by default")
    assert items[0].meaning == "How many, and of what."
    with pytest.raises(ScenarioError, match=r"there is no '1' in 'cars'; allowed: 0"):
        values_table(Train(), "cars.1")


def test_an_array_is_explained() -> None:
    (line,) = values_table(load_scenario("drawer")[1], "control.posture")
    assert line.meaning


@pytest.mark.parametrize("application", applications().values(), ids=lambda one: one.name)
def test_all_values_that_the_scenarios_may_hold_are_explained(application: Application) -> None:
    explained, missing = 0, []
    for owner in dataclasses_in(application.scenario):
        hints = get_type_hints(owner)
        for item in fields(owner):
            if is_dataclass(hints[item.name]):
                continue
            explained += 1
            if not comments(owner).get(item.name):
                missing.append(f"{owner.__name__}.{item.name}")
    assert missing == []
    assert explained > 100


def dataclasses_in(schema: Any) -> set[type]:
    """A dataclass and those that its fields, their lists and their mappings hold."""
    if not is_dataclass(schema):
        return set().union(*map(dataclasses_in, get_args(schema)))
    below = map(dataclasses_in, get_type_hints(schema).values())
    return {cast(type, schema)}.union(*below)


def test_a_declared_unit_is_found_by_its_key() -> None:
    of_car = [(Car, "spare.radius"), (Car, "wheels.left.centre")]
    for config, key in [*of_car, (Trailer, "wheel.radius")]:
        assert unit_at(config, key) == "m"
    for key in (
        "spare.spokes",
        "spare.none",
        "wheels.left",
        "wheels",
        "none.radius",
        "spare.radius.x",
    ):
        assert unit_at(Car, key) == ""
