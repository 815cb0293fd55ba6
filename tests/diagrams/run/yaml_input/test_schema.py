"""YAML becomes config dataclasses; what is wrong with it is said in one line."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from crossmodal.diagrams.run.yaml_input.loader import apply_override, read_yaml
from crossmodal.diagrams.run.yaml_input.schema import (
    ScenarioError,
    load_typed,
    one_line,
    suggestion,
)


@dataclass(kw_only=True)
class Lens:
    angle: float = 58.0
    tilt: float = 0.0


@dataclass(kw_only=True)
class Eye:
    width: int = 640
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    lens: Lens = field(default_factory=Lens)


def _two_eyes() -> dict[str, Eye]:
    return {
        "left": Eye(width=320, position=np.array([0.1, 0.2, 0.3]), lens=Lens(angle=90.0)),
        "right": Eye(width=160),
    }


@dataclass(kw_only=True)
class Head:
    eyes: dict[str, Eye] = field(default_factory=_two_eyes)
    labels: dict[str, str] = field(default_factory=lambda: {"left": "L"})


@dataclass(kw_only=True)
class Robot:
    name: str = ""
    head: Head = field(default_factory=Head)
    eyes: dict[str, Eye] = field(default_factory=_two_eyes)
    spare: Lens | None = None
    gains: list[float] = field(default_factory=lambda: [1.0, 2.0])


def load(document: dict) -> Robot:
    return load_typed(Robot, document, "mine.yaml")


def test_what_is_absent_keeps_its_default() -> None:
    robot = load({"name": "a"})
    assert set(robot.eyes) == {"left", "right"}
    assert robot.eyes["left"].width == 320
    assert robot.gains == [1.0, 2.0]


def test_a_named_part_keeps_the_defaults_values_of_what_is_not_said_of_it() -> None:
    left = load({"eyes": {"left": {"width": 64}}}).eyes["left"]
    assert left.width == 64
    assert left.position.tolist() == [0.1, 0.2, 0.3]
    assert left.lens.angle == 90.0
    left = load({"eyes": {"left": {"lens": {"tilt": 3.0}}}}).eyes["left"]
    assert (left.lens.angle, left.lens.tilt, left.width) == (90.0, 3.0, 320)


def test_there_are_the_named_parts_that_are_said_and_no_others() -> None:
    eyes = load({"eyes": {"left": {}, "third": {"width": 1}}}).eyes
    assert set(eyes) == {"left", "third"}
    assert eyes["left"].width == 320
    assert eyes["third"].position.tolist() == [0.0, 0.0, 0.0]
    assert load({"eyes": {}}).eyes == {}


def test_parts_within_parts_keep_their_defaults_too() -> None:
    robot = load({"head": {"eyes": {"left": {"position": [1, 2, 3]}}}})
    assert robot.head.eyes["left"].position.tolist() == [1.0, 2.0, 3.0]
    assert robot.head.eyes["left"].width == 320
    assert robot.head.labels == {"left": "L"}
    assert robot.eyes["left"].position.tolist() == [0.1, 0.2, 0.3]


def test_plain_mappings_lists_and_optional_parts_are_replaced() -> None:
    robot = load({"head": {"labels": {"right": "R"}}, "gains": [3], "spare": {"tilt": 1}})
    assert robot.head.labels == {"right": "R"}
    assert robot.gains == [3.0]
    assert robot.spare == Lens(tilt=1.0)


def test_loading_one_does_not_change_the_defaults_of_the_next() -> None:
    load({"eyes": {"left": {"width": 1}}})
    assert load({}).eyes["left"].width == 320


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"nam": "a"}, "mine.yaml: unknown key 'nam'; did you mean 'name'?"),
        ({"eyes": {"left": {"widht": 1}}}, "unknown key 'eyes.left.widht'; did you mean 'width'?"),
        (
            {"eyes": {"left": 3}},
            "eyes.left = 3, but it must be a mapping of some of these keys: lens, position, width",
        ),
        ({"eyes": {"left": None}}, "eyes.left = None, but it must be a mapping"),
        ({"eyes": [1]}, "eyes = [1], but it must be a mapping"),
        ({"eyes": {"left": {"width": 1.5}}}, "eyes.left.width = 1.5, but it must be a whole"),
        ({"eyes": {"left": {"position": "up"}}}, "eyes.left.position = 'up', but it must be num"),
        ({"gains": ["x"]}, "gains.0 = 'x', but it must be a number"),
        ({"gains": [10**400]}, "gains.0 = 1"),
        ({"eyes": {"left": {"position": [0, 0, 10**400]}}}, "eyes.left.position.2 = 1"),
        ({"name": 3}, "name = 3, but it must be text"),
        ({"eyes": {"left": {"position": [1, None]}}}, "position.1 = None, but it must be a num"),
        ({"eyes": {"left": {"position": [True, 1]}}}, "position.0 = True, but it must be a num"),
        ({"eyes": {"left": {"position": [[1], [1, 2]]}}}, "but it must be numbers in a list"),
        ({"gains": [None]}, "gains.0 = None, but it must be a number"),
        ({"na\nme": 3}, "mine.yaml: unknown key 'na me'"),
        ({"name": [["deep"] * 1000] * 1000}, "name = [['deep', 'deep', "),
        ({"spare": {"tlt": 3}}, "unknown key 'spare.tlt'; did you mean 'tilt'?"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_path(document: dict, expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(document)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_power_of_ten_is_a_number() -> None:
    assert load({"eyes": {"left": {"lens": {"tilt": "1e-3"}}}}).eyes["left"].lens.tilt == 1e-3


def test_files_that_are_no_mapping_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    for text, expected in (
        ("- a\n- b\n", "must hold a mapping"),
        ("a: 3\nb: [a\n", "is not valid YAML: line 3"),
        ("", ""),
    ):
        path.write_text(text)
        if not expected:
            assert read_yaml(path) == {}
            continue
        with pytest.raises(ScenarioError, match=expected):
            read_yaml(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_yaml(path)
    with pytest.raises(ScenarioError, match="there is no such file"):
        read_yaml(tmp_path / "none.yaml")


def test_overrides_reach_into_lists_and_make_missing_mappings() -> None:
    document: dict = {"a": [{"b": 1}]}
    apply_override(document, "a.0.b=2")
    apply_override(document, "c.d.e=[1, 2]")
    assert document == {"a": [{"b": 2}], "c": {"d": {"e": [1, 2]}}}


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("a", "expected key.path=value"),
        ("a..b=1", "expected key.path=value"),
        ("a.5=1", "not one of the 1 elements"),
        ("b.c=1", "inside a plain value"),
        ("a=[1", "--set a=[1: is not valid YAML: line"),
    ],
)
def test_overrides_that_lead_nowhere_are_refused(assignment: str, expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        apply_override({"a": [1], "b": 3}, assignment)
    assert expected in str(caught.value)


def test_a_suggestion_names_the_nearest_and_all() -> None:
    assert suggestion("drawr", ["door", "drawer"]) == "did you mean 'drawer'? allowed: door, drawer"
    assert suggestion("x", []) == "allowed: none"
    streams = ["depth_measured", "pressure_window"]
    assert "mean 'pressure_window'?" in suggestion("pressure_measured", streams)
    assert one_line("a\n  b") == "a b"
