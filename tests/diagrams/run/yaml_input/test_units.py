"""Numbers with a unit in a scenario become numbers in the unit of their field."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, load_typed
from crossmodal.maths.validation import number, numbers


@dataclass(kw_only=True)
class Wheel:
    radius: float = number(0.3, above=0.0, at_most=10.0, unit="m")
    turn: float | None = number(None, at_least=-9.0, at_most=9.0, unit="m or rad")
    share: float = number(0.5, at_least=0.0, at_most=1.0)


@dataclass(kw_only=True)
class Car:
    name: str = ""
    width: int = number(640, at_least=1, at_most=9999, unit="px")
    place: np.ndarray = numbers(np.zeros(3), at_least=-9.0, at_most=9.0, unit="m")
    stops: list[float] = numbers([1.0], at_least=0.0, at_most=999.0, unit="s", shape=None)
    gains: dict[str, float] = numbers({}, at_least=0.0, at_most=9e9, unit="N/m", shape=None)
    wheels: dict[str, list[Wheel]] = field(default_factory=dict)


def load(document: dict) -> Car:
    return load_typed(Car, document, "mine.yaml")


def test_a_number_with_a_unit_is_read_wherever_a_number_may_be() -> None:
    car = load(
        {
            "name": "5 cm",
            "width": "320 px",
            "place": ["5 cm", 0.2, "-20mm"],
            "stops": ["2 min", 3],
            "gains": {"front": "2 N/mm"},
            "wheels": {"left": [{"radius": "20 cm", "turn": "90 deg"}, {"turn": None}]},
        }
    )
    assert (car.name, car.width) == ("5 cm", 320)
    assert car.place.tolist() == [0.05, 0.2, -0.02]
    assert car.stops == [120.0, 3.0]
    assert car.gains == {"front": 2000.0}
    first, second = car.wheels["left"]
    assert (first.radius, first.turn, second.turn) == (0.2, 0.5 * np.pi, None)


def test_a_document_is_left_as_it_is() -> None:
    document = {"place": ["5 cm", 0, 0]}
    load(document)
    assert document == {"place": ["5 cm", 0, 0]}


@pytest.mark.parametrize("text", ["1e-3", "1001", "1E3", "+1.5"])
def test_a_number_that_yaml_reads_as_text_has_no_unit(text: str) -> None:
    assert load({"stops": [text]}).stops == [float(text)]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"place": [0, "30 deg", 0]}, "mine.yaml: place.1 = '30 deg', but it must be in m"),
        ({"wheels": {"left": [{"radius": "3 s"}]}}, "wheels.left.0.radius = '3 s', but it must be"),
        ({"wheels": {"left": [{"turn": "3 s"}]}}, "turn = '3 s', but it must be in m or rad"),
        ({"wheels": {"left": [{"share": "3 s"}]}}, "= '3 s', but it must be a number without a"),
        ({"width": "1.5 px"}, "width = 1.5, but it must be a whole number"),
    ],
)
def test_a_unit_of_something_else_is_refused_with_field_value_and_unit(
    document: dict, message: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(document)
    assert message in str(caught.value)


def test_a_unit_that_a_field_leaves_open_is_the_scenario_s() -> None:
    document = {"wheels": {"left": [{"turn": "5 cm", "radius": "5 cm"}]}}
    load_typed(Car, document, "mine.yaml", lambda: {"wheels.left.0.turn": "m"})
    with pytest.raises(ScenarioError, match=r"turn = '5 cm', but it must be in rad"):
        load_typed(Car, document, "mine.yaml", lambda: {"wheels.left.0.turn": "rad"})


def test_a_goal_is_a_way_where_the_joint_slides_and_an_angle_where_it_turns() -> None:
    assert load_scenario("drawer-return", ["task.goal=20 cm"])[1].task.goal == 0.2
    assert load_scenario("glass-door", ["task.goal=20 deg"])[1].task.goal == np.deg2rad(20.0)
    with pytest.raises(ScenarioError, match=r"task\.goal = '20 deg', but it must be in m "):
        load_scenario("drawer-return", ["task.goal=20 deg"])
    with pytest.raises(ScenarioError, match=r"friction = '2 N', but it must be in N m "):
        load_scenario("glass-door", ["objects.door.friction=2 N"])
