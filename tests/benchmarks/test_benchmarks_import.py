"""Each benchmark still finds what it imports of the project."""

from importlib import import_module
from pathlib import Path

import pytest

import benchmarks

NAMES = sorted(path.stem for path in Path(benchmarks.__path__[0]).glob("*.py"))


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith("_")])
def test_it_imports(name: str) -> None:
    try:
        import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ("crossmodal", "benchmarks", "tests"):
            raise
        pytest.skip(f"needs {error.name}, which is not installed")
