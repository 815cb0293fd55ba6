"""Impossible configuration values are refused, and the message names what is possible."""

from dataclasses import dataclass, field
from math import inf, nan

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from crossmodal.maths.validation import check, declared, number, numbers, require


@dataclass(kw_only=True)
class Finger:
    length: float = number(0.1, above=0.0, below=1.0, unit="m")
    rates: list[float] = numbers([1.0, 2.0], at_least=0.0, at_most=9.0, unit="m^3/rad")


@dataclass(kw_only=True)
class Arm:
    period: float = number(0.01, above=0.0, at_most=10.0, unit="s")
    retries: int = number(2, at_least=0, at_most=100)
    end: float = number(inf, above=0.0, at_most=50.0, unit="s", infinite=True)
    goal: float | None = number(None, above=0.0, at_most=2.0, unit="rad")
    position: np.ndarray = numbers(np.zeros(3), at_least=-10.0, at_most=10.0, unit="m")
    densities: list[float] = numbers([1.0], above=0.0, at_most=9.0, shape=(range(1, 4),))
    undeclared: float = 0.0
    name: str = ""
    thumb: Finger = field(default_factory=Finger)
    spare: Finger | None = None
    fingers: dict[str, Finger] = field(default_factory=dict)
    joints: list[Finger] = field(default_factory=list)
    speeds: dict[str, float] = numbers({"slow": 0.1}, above=0.0, at_most=1.0, unit="m/s")


def refusal(config: object) -> str:
    with pytest.raises(ValueError, match=r"^Arm: .*, need") as caught:
        check(config, "Arm")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_defaults_and_values_at_a_closed_end_are_possible() -> None:
    check(Arm(), "Arm")
    check(Arm(period=10.0, retries=0, goal=2.0, position=np.full(3, -10.0)), "Arm")


@pytest.mark.parametrize("value", [0.0, -1.0, 10.1, 1e300, nan, inf, -inf, np.float64(-2.0)])
def test_what_is_outside_its_range_or_not_finite_is_refused(value: float) -> None:
    text = repr(float(value))
    assert refusal(Arm(period=value)) == f"Arm: period = {text} s, need > 0, <= 10 s"


def test_an_open_end_is_not_possible_itself() -> None:
    assert "need > 0, < 1 m" in refusal(Arm(thumb=Finger(length=1.0)))


def test_a_whole_number_too_large_for_a_float_is_refused() -> None:
    assert refusal(Arm(retries=10**400)).endswith(", need >= 0, <= 100")


def test_infinity_is_possible_only_where_it_is_declared_and_nothing_between() -> None:
    check(Arm(end=inf), "Arm")
    for value in (51.0, 1e300, -inf, nan):
        assert refusal(Arm(end=value)).endswith("s, need > 0, <= 50 s, or infinite")


def test_none_is_no_number() -> None:
    check(Arm(goal=None), "Arm")
    assert refusal(Arm(goal=nan)) == "Arm: goal = nan rad, need > 0, <= 2 rad"


def test_each_number_of_an_array_is_checked_and_their_count() -> None:
    expected = "need 3 numbers, each >= -10, <= 10 m"
    for value in ([0.0, nan, 0.0], [0.0, 0.0, 11.0], [0.0, 0.0], [[0.0, 0.0, 0.0]]):
        message = refusal(Arm(position=np.array(value)))
        assert message == f"Arm: position = {value!r} m, {expected}"


def test_a_list_may_have_as_many_numbers_as_is_declared() -> None:
    check(Arm(densities=[1.0, 2.0, 3.0]), "Arm")
    for value in ([], [1.0] * 4, [0.0]):
        assert "need 1 to 3 numbers, each > 0, <= 9" in refusal(Arm(densities=value))
    assert "need 2 numbers, each" in refusal(Arm(thumb=Finger(rates=[1.0])))


def test_a_number_of_which_nothing_is_declared_must_be_finite() -> None:
    check(Arm(undeclared=-1e300), "Arm")
    for value in (nan, inf, -inf):
        assert refusal(Arm(undeclared=value)) == (
            f"Arm: undeclared = {value!r}, need a finite number"
        )


@pytest.mark.parametrize(
    ("config", "path"),
    [
        (Arm(thumb=Finger(length=nan)), "thumb.length"),
        (Arm(spare=Finger(length=nan)), "spare.length"),
        (Arm(fingers={"index": Finger(), "ring": Finger(length=nan)}), "fingers.ring.length"),
        (Arm(joints=[Finger(), Finger(length=nan)]), "joints.1.length"),
        (Arm(speeds={"slow": 0.1, "fast": nan}), "speeds.fast"),
    ],
)
def test_the_path_of_what_is_refused_is_named(config: Arm, path: str) -> None:
    assert refusal(config).startswith(f"Arm: {path} = nan m")


@pytest.mark.parametrize(
    "ends",
    [
        {},
        {"above": 0.0},
        {"at_most": 1.0},
        {"above": 0.0, "at_least": 0.0, "at_most": 1.0},
        {"above": 0.0, "at_most": inf},
        {"at_least": nan, "below": 1.0},
    ],
)
def test_a_range_without_two_finite_ends_cannot_be_declared(ends: dict[str, float]) -> None:
    with pytest.raises(TypeError, match="one finite end"):
        number(0.5, **ends)
    with pytest.raises(TypeError, match="one finite end"):
        numbers([0.5], **ends)


def test_two_configurations_share_no_array() -> None:
    first, second = Arm(), Arm()
    first.position[0] = 1.0
    first.thumb.rates.append(1.0)
    assert_array_equal(second.position, np.zeros(3))
    assert second.thumb.rates == Finger().rates == [1.0, 2.0]


def test_drake_reads_and_writes_a_configuration_with_declarations() -> None:
    config = yaml_load_typed(
        schema=Finger, data="{length: 0.2, rates: [3.0, 4.0]}", defaults=Finger()
    )
    assert (config.length, config.rates) == (0.2, [3.0, 4.0])
    assert yaml_load_typed(schema=Finger, data="{}").length == 0.1
    assert yaml_load_typed(schema=Finger, data=yaml_dump_typed(config)) == config
    with pytest.raises(RuntimeError, match="lenght"):
        yaml_load_typed(schema=Finger, data="{lenght: 0.2}")


def test_what_was_declared_of_a_field_can_be_asked() -> None:
    items = {item.name: item for item in Arm.__dataclass_fields__.values()}
    period = declared(items["period"])
    assert period is not None
    assert (str(period), period.unit) == ("> 0, <= 10 s", "s")
    assert declared(items["undeclared"]) is None


def test_a_relation_names_system_field_value_unit_and_what_is_allowed() -> None:
    config = Arm(period=3.0)
    require(True, "Arm", config, "period", "<= the end")
    with pytest.raises(ValueError, match=r"^Arm: period = 3\.0 s, need <= the end$"):
        require(False, "Arm", config, "period", "<= the end")
    with pytest.raises(ValueError, match=r"^Arm: thumb\.length = 0\.1 m, need less$"):
        require(False, "Arm", config, "thumb.length", "less")
    with pytest.raises(ValueError, match=r"^Arm: name = '', need one$"):
        require(False, "Arm", config, "name", "one")
