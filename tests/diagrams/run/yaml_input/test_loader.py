"""A file or an assignment is read, or refused in one line."""

import os
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crossmodal.diagrams.run.scenario import Scenario, parse_scenario, read_document
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

SEARCH = settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
MARKS = st.text("abse :-[]{},!|>'\"%@`?#\n\t01.~<=\\")
TOKENS = """
    system: name: seed: duration: cameras: calibration: [ ] { } , - ? : ~ true 1 0.5
    1e3 .nan .inf 2026-01-02 12:30:45 0xff 99999999999999999999 vision # --- @
"""
WORDS = st.lists(st.sampled_from([*TOKENS.split(), "\n", "\n  ", "\n- ", "\t", " "])).map(" ".join)


@SEARCH
@given(text=MARKS | WORDS)
def test_any_file_is_a_scenario_or_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    said = ""
    try:
        parse_scenario(Scenario, read_document(path), path)
    except ScenarioError as error:
        said = str(error)
    assert not said or (said.isprintable() and said.startswith(str(path)))


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    said = {"a": [1, 0.5, None, True, "text"], "b": {"c": {}, "d": "5 cm"}}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(said))
    assert read_yaml(path) == said


NINES = [f"{c}: &{c} [{', '.join([f'*{p}'] * 9)}]\n" for p, c in pairwise("abcdefghi")]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: [" + "1.5, " * 200_000 + "2]", "holds more than 100000 values"),
        ("[" * 100_000, "maximum nesting depth|within each other|is not valid YAML"),
        ("a: " + "{b: " * 3000, "within each other"),
        (f"a: &a [{', '.join('x' * 9)}]\n{''.join(NINES)}", "holds more than 100000 values"),
    ],
    ids=["long", "deep", "deep mappings", "nine billion"],
)
def test_what_would_fill_the_memory_is_refused(text: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=why):
        read_yaml(path)


@pytest.mark.parametrize("text", ["a: &a {b: *a}", "a: {b: &b [*b]}", "&a {b: [*a]}"])
def test_what_holds_itself_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match="stands within itself"):
        read_yaml(path)


def test_nobody_waits_at_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "mine.yaml")
    with pytest.raises(ScenarioError, match=r"mine\.yaml: cannot be read: it is no file"):
        read_yaml(tmp_path / "mine.yaml")


def test_a_key_that_is_there_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("a:\n  b: 1\n  c: 2\n  b: 3\n")
    with pytest.raises(ScenarioError, match=r"line 4, .*'b' is there already, in line 2"):
        read_yaml(path)
