"""A scenario's values with what they may be and what they mean."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from crossmodal.diagrams.applications import applications, load_scenario, scenarios_of
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.run.yaml_input.values_table import unit_at, values_table
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


@pytest.mark.parametrize("name", sorted(applications()))
def test_most_numbers_of_the_scenarios_are_explained(name: str) -> None:
    path = next(iter(scenarios_of(applications()[name]).values()))
    lines = values_table(load_scenario(str(path))[1])
    ranged = [line for line in lines if line.possible]
    assert len(ranged) > 100
    assert np.mean([bool(line.meaning) for line in ranged]) > 0.8


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
