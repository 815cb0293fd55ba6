"""The wheel is whole: what it installs runs in another folder and has all of its data."""

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from crossmodal.diagrams.applications import scenario_files

ROOT = Path(__file__).parents[1]
ROOMS = ("maths", "models", "plants", "systems", "controllers", "diagrams")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of a copy of this checkout, installed without what it depends on."""
    folder = tmp_path_factory.mktemp("wheel")
    source, target = folder / "source", folder / "site"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    unwanted = shutil.ignore_patterns("__pycache__")
    for name in ("crossmodal", *ROOMS):
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=unwanted)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    without = ["--no-deps", "--no-index"]
    wheels = ["--wheel-dir", str(folder)]
    subprocess.run([*pip, "wheel", *without, "--no-build-isolation", *wheels, source], check=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([*pip, "install", *without, "--target", target, wheel], check=True)
    return target


def data_files(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for room in ROOMS
        for path in (folder / room).rglob("*.*")
        if path.is_file() and path.suffix not in (".py", ".pyc", ".nbi", ".nbc")
    }


def test_it_holds_every_file_of_the_rooms(installed: Path) -> None:
    found = data_files(installed / "crossmodal")
    assert found == data_files(ROOT)
    assert {
        "models/sdf/textures/oak.png",
        "models/sdf/table_scene.dmd.yaml",
        "models/weights/hand_bending.npz",
        "models/weights/segmentation.onnx",
        "models/examples/two_drawers.urdf",
        "diagrams/drawing/page_style.html",
        "diagrams/drawing/page.html.jinja",
    } < found


def test_it_loads_every_scenario_beside_modules_called_like_its_rooms(
    installed: Path, tmp_path: Path
) -> None:
    (tmp_path / "systems.py").write_text("raise RuntimeError('another one')")
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "__init__.py").write_text("raise RuntimeError('another one')")
    code = (
        "import crossmodal.diagrams.command_line as c; print(c.__file__);"
        "from crossmodal.diagrams.drawing.page import page; page('a', 'b', []);"
        "c.app(['list'])"
    )
    result = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed), "CROSSMODAL_APPLICATIONS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    first, *lines = result.stdout.splitlines()
    assert Path(first).is_relative_to(installed)
    listed = {line.split()[0] for line in lines if line.startswith("  ")}
    assert set(scenario_files()) <= listed


def test_what_it_imports_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    declared = [*project["dependencies"]]
    for extra in ("train", "cluster", "foxglove", "video"):
        declared += extras[extra]
    names = {Requirement(line).name.lower() for line in declared}
    known = packages_distributions()
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                modules = (
                    [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                )
                modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                for module in modules:
                    package = module.partition(".")[0]
                    if package not in (*sys.stdlib_module_names, "crossmodal"):
                        found = {name.lower() for name in known.get(package, [package])}
                        assert found & names, f"{path} imports {package}"
