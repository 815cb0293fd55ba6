"""Errors in code of a user's own are told by its file and line, others not."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from crossmodal.diagrams.run import own_code
from crossmodal.diagrams.run.own_module import load_module

CODE = """import json


def lost(text):
    return json.loads(text)
"""


def error_of(call: Callable[[], object]) -> BaseException:
    with pytest.raises(Exception) as caught:  # noqa: PT011
        call()
    return caught.value


def test_the_innermost_line_of_ones_own_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "puck.py").write_text(CODE)
    module = load_module(str(tmp_path / "puck.py"), "puck")
    error = error_of(lambda: module.lost("{"))
    assert isinstance(error, json.JSONDecodeError)
    assert own_code.told(error).startswith("puck.py:5: JSONDecodeError: ")
    # Of an installed package it is told where that has an application.
    monkeypatch.setattr(own_code, "_INSTALLED", (*own_code._INSTALLED, str(tmp_path)))
    assert not own_code.place_of(error).startswith("puck.py")
    monkeypatch.setattr(own_code, "_applications", lambda: {module.__name__.partition(".")[0]})
    assert own_code.place_of(error) == "puck.py:5"
