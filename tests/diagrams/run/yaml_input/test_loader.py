"""Any text is a value or is refused; hypothesis looks for one that is neither."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crossmodal.diagrams.run.scenario import Scenario, parse_scenario, read_document
from crossmodal.diagrams.run.yaml_input.loader import MOST_LEVELS, load_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

SEARCH = settings(
    max_examples=300,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63) + 1, 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("abc on1~-2.<="), inner),
    max_leaves=10,
)
MARKS = st.text("abse :-[]{},&*!|>'\"%@`?#\n\t01.~<=\\")
TOKENS = """
    system: name: seed: duration: cameras: modalities: disturbances: calibration: versions:
    [ ] { } , - ? : ~ &a *a !!int !!float !!bool !!set !!binary !!timestamp !own | > ' " # << =
    true 1 0.5 1e3 .nan .inf 2026-01-02 12:30:45 0xff 0o7 1_000 99999999999999999999 vision
    --- ... % @ \\ "\\ud800" "\\0" lights_off start end width position
"""
WORDS = st.lists(st.sampled_from([*TOKENS.split(), "\n", "\n  ", "\n    ", "\n- ", "\t", " "])).map(
    " ".join
)


class _Unshared(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def refusal(path: Path, overrides: list[str]) -> str:
    """Why there is no scenario; nothing where there is one."""
    try:
        parse_scenario(Scenario, read_document(path, overrides), path)
    except ScenarioError as error:
        return str(error)
    return ""


def check(said: str, path: Path) -> None:
    assert not said or (said.isprintable() and said.startswith((str(path), "--set")))


@SEARCH
@given(text=st.text() | MARKS | WORDS)
def test_any_file_is_a_scenario_or_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    check(refusal(path, []), path)


@SEARCH
@given(data=st.binary())
def test_any_bytes_are_a_scenario_or_are_refused_in_one_line(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(data)
    check(refusal(path, []), path)


@SEARCH
@given(
    key=st.sampled_from(list(vars(Scenario()))) | st.text(),
    rest=st.sampled_from(["", ".a", ".0", ".lights_off", ".errors", ".a.width"]),
    value=st.text() | MARKS | WORDS,
)
def test_any_assignment_is_taken_or_refused_in_one_line(
    key: str, rest: str, value: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("cameras: {a: {}}\ndisturbances: {lights_off: [{start: 1}]}\n")
    check(refusal(path, [f"{key}{rest}={value}"]), path)


@SEARCH
@given(value=PLAIN)
def test_what_is_written_is_read_again(value: Any) -> None:
    assert load_yaml(yaml.dump(value, Dumper=_Unshared)) == value


def test_there_are_no_other_types_than_numbers_text_and_truths() -> None:
    found = load_yaml("[2026-01-02, 12:30:45, =, <<, ~, on, 1, 0.5, .inf]")
    assert found == ["2026-01-02", 45045, "=", "<<", None, True, 1, 0.5, math.inf]


@pytest.mark.parametrize("levels", [MOST_LEVELS, MOST_LEVELS + 1])
def test_so_many_levels_are_read_and_no_more(levels: int) -> None:
    text = "[" * levels + "]" * levels
    if levels == MOST_LEVELS:
        assert load_yaml(text)
        return
    with pytest.raises(yaml.YAMLError, match="more than 40 levels"):
        load_yaml(text)


def test_a_key_that_is_there_twice_is_refused_with_both_lines() -> None:
    with pytest.raises(yaml.MarkedYAMLError, match="'b' is there already, in line 2") as caught:
        load_yaml("a:\n  b: 1\n  c: 2\n  b: 3\n")
    assert caught.value.problem_mark.line == 3
