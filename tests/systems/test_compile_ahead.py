"""What an episode calls is listed, and is compiled before it begins, in other processes."""

import os
import shutil
import subprocess
import sys
from importlib import import_module
from itertools import chain
from pathlib import Path

import pytest
import yaml

import crossmodal
from crossmodal.systems import compile_ahead

ROOT = Path(crossmodal.__file__).parents[1]
FUNCTION = """
from typing import NamedTuple

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot

class Point(NamedTuple):
    x: Array

@hot
def double(point: Point, share: float) -> float:
    return 2.0 * share * point.x[0]

@hot
def half(x: float) -> float:
    return 0.5 * x
"""
LIST = {
    "named_tuples": {"crossmodal.systems.mine.Point": "float64[::1]"},
    "functions": {
        "own": {
            "crossmodal.systems.mine.double": ["Point, float64"],
            "crossmodal.systems.other.triple": ["float64"],
        },
        "another": {"crossmodal.systems.mine.half": ["float64"]},
    },
}
CALL = """
import numpy as np
from crossmodal.maths.compiled import compilation_timed
from crossmodal.systems.compile_ahead import compile_ahead, is_kept
from crossmodal.systems.mine import Point, double, half
with compilation_timed() as compiling:
    compile_ahead("own")
assert double(Point(np.ones(3)), 0.5) == 1.0
print(sum(double.stats.cache_misses.values()), compiling.seconds > 0.1, is_kept(half))
"""
# Of all that an application has called, what is not listed for it.
UNLISTED = """
from crossmodal.systems.compile_ahead import listed
from tests.systems.write_compiled_ahead import *
with noted_calls() as calls:
    {what}
listed = listed("{application}")
print(*calls - {{(f"{{d.__module__}}.{{d.__name__}}", signature) for d, signature in listed}})
"""


def test_every_listed_function_is_there_and_can_be_compiled_for_its_types() -> None:
    of_each = yaml.safe_load(compile_ahead.LIST.read_text())["functions"]
    for name in chain.from_iterable(of_each.values()):
        import_module(name.rpartition(".")[0])
    for application, functions in of_each.items():
        found = list(compile_ahead.listed(application))
        assert len(found) == sum(len(signatures) for signatures in functions.values()) > 5
    found = list(compile_ahead.listed("one's own"))
    assert len(found) > 50
    for dispatcher, signature in found:
        names = dispatcher.py_func.__code__.co_argcount
        assert len(signature) == names, dispatcher.__name__


def test_other_processes_compile_what_the_application_needs_and_no_more(tmp_path: Path) -> None:
    package = tmp_path / "crossmodal"
    (package / "systems").mkdir(parents=True)
    (package / "__init__.py").touch()
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "crossmodal/maths", package / "maths", ignore=ignored)
    for name in ("__init__.py", "compile_ahead.py"):
        shutil.copy(ROOT / "crossmodal/systems" / name, package / "systems")
    (package / "systems/mine.py").write_text(FUNCTION)
    (package / "systems/compiled_ahead.yaml").write_text(yaml.safe_dump(LIST))
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}

    def run() -> str:
        command = [sys.executable, "-c", CALL]
        return subprocess.run(
            command, cwd=tmp_path, env=env, capture_output=True, text=True, check=True
        ).stdout

    assert run() == "0 True False\n"
    assert run() == "0 False False\n"  # The second time there is nothing to do.


@pytest.mark.parametrize(
    ("application", "what"),
    [
        ("crossmodal", "perceive(RECORDINGS[1])"),
        ("joints", "find_joints()"),
        (
            "clutter",
            "run_episode(*load_scenario('pose-estimation', ['touches.chosen_touches=1']))",
        ),
    ],
)
def test_all_that_an_application_needs_is_listed(application: str, what: str) -> None:
    command = [sys.executable, "-c", UNLISTED.format(application=application, what=what)]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "", (
        "python -m tests.systems.write_compiled_ahead writes the list anew"
    )
