"""What an episode calls is listed, and is compiled before it begins, in other processes."""

import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

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
"""
LIST = {
    "named_tuples": {"crossmodal.systems.mine.Point": "float64[::1]"},
    "functions": {
        "crossmodal.systems.mine.double": ["Point, float64"],
        "crossmodal.systems.other.triple": ["float64"],
    },
}
CALL = """
import numpy as np
from crossmodal.maths.compiled import compilation_timed
from crossmodal.systems.compile_ahead import compile_ahead
from crossmodal.systems.mine import Point, double
with compilation_timed() as compiling:
    compile_ahead()
assert double(Point(np.ones(3)), 0.5) == 1.0
print(sum(double.stats.cache_misses.values()), compiling.seconds > 0.1)
"""
# Of all that the episode has called, what is not in the list.
UNLISTED = """
import sys
sys.path.insert(0, "tests/recordings")
from outputs import RECORDINGS, perceive
from crossmodal.systems.compile_ahead import listed
from tests.systems.write_compiled_ahead import noted_calls
with noted_calls() as calls:
    perceive(RECORDINGS[1])
print(*calls - {(f"{d.__module__}.{d.__name__}", signature) for d, signature in listed()})
"""


def test_every_listed_function_is_there_and_can_be_compiled_for_its_types() -> None:
    functions = yaml.safe_load(compile_ahead.LIST.read_text())["functions"]
    for name in functions:
        import_module(name.rpartition(".")[0])
    found = list(compile_ahead.listed())
    assert len(found) == sum(len(signatures) for signatures in functions.values()) > 50
    for dispatcher, signature in found:
        names = dispatcher.py_func.__code__.co_argcount
        assert len(signature) == names, dispatcher.__name__


def test_other_processes_compile_what_is_imported_and_no_more(tmp_path: Path) -> None:
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

    assert run() == "0 True\n"
    assert run() == "0 False\n"  # The second time there is nothing to do.


def test_all_that_a_recording_needs_is_listed() -> None:
    command = [sys.executable, "-c", UNLISTED]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "", (
        "python -m tests.systems.write_compiled_ahead writes the list anew"
    )
