"""Compiled code is read from the disk, but not when anything that it was made from has changed."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

from numba.core.registry import CPUDispatcher

from crossmodal import maths, systems
from crossmodal.maths.compiled_cache import _AllSources

CALLER = """
from crossmodal.maths.compiled import hot
from crossmodal.systems.callee import double

@hot
def quadruple(x: float) -> float:
    return double(double(x))
"""
CALLEE = """
from crossmodal.maths.compiled import hot
from crossmodal.systems.constants import TWO

@hot
def double(x: float) -> float:
    return TWO * x
"""
PRINT = """
from crossmodal.systems.caller import quadruple
print(quadruple(1.0), sum(quadruple.stats.cache_hits.values()))
"""


def _checkout(folder: Path) -> Path:
    """A small checkout of its own; returns its folder of systems."""
    package = folder / "crossmodal" / "systems"
    package.mkdir(parents=True)
    (folder / "crossmodal" / "__init__.py").touch()
    shutil.copytree(
        Path(maths.__file__).parent,
        folder / "crossmodal" / "maths",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    shutil.copy(systems.__file__, package)
    (package / "caller.py").write_text(CALLER)
    (package / "callee.py").write_text(CALLEE)
    (package / "constants.py").write_text("TWO = 2.0\n")
    return package


def _run(folder: Path, script: str = PRINT) -> str:
    command = [sys.executable, "-c", script]
    # The cache is looked for beside the sources, wherever the caller's own is.
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    found = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=True)
    return found.stdout.strip()


def test_a_caller_is_compiled_again_when_what_it_calls_or_a_constant_changes(
    tmp_path: Path,
) -> None:
    package = _checkout(tmp_path)
    assert _run(tmp_path) == "4.0 0"
    assert _run(tmp_path) == "4.0 1"
    (package / "constants.py").write_text("TWO = 3.0\n")
    assert _run(tmp_path) == "9.0 0"
    (package / "callee.py").write_text(CALLEE.replace("TWO * x", "TWO * x + 1.0"))
    assert _run(tmp_path) == "13.0 0"
    assert _run(tmp_path) == "13.0 1"
    folders = sorted((package / "__pycache__").glob("c*-*/"))
    assert [folder.name.split("-")[0] for folder in folders] == ["callee", "caller"]


def test_a_type_that_has_moved_to_another_module_is_not_looked_for_in_the_old_one(
    tmp_path: Path,
) -> None:
    package = _checkout(tmp_path)
    point = "from typing import NamedTuple\n\nclass Point(NamedTuple):\n    x: float\n"
    (package / "here.py").write_text(point)
    caller = CALLER.replace(
        "crossmodal.systems.callee import double", "crossmodal.systems.here import Point"
    )
    caller = caller.replace("(x: float)", "(p: Point)").replace("double(double(x))", "4.0 * p.x")
    script = PRINT.replace("import quadruple", "import Point, quadruple").replace(
        "1.0", "Point(1.0)"
    )
    (package / "caller.py").write_text(caller)
    assert _run(tmp_path, script) == "4.0 0"
    (package / "here.py").rename(package / "there.py")
    (package / "caller.py").write_text(caller.replace("here", "there"))
    assert _run(tmp_path, script) == "4.0 0"


def test_every_compiled_function_is_kept_so() -> None:
    found = 0
    for package in (maths, systems):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, CPUDispatcher):
                    found += 1
                    assert isinstance(value._cache._impl.locator, _AllSources)
    assert found > 5
