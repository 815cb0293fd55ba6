"""Which files a module consists of, and a hash of them."""

from pathlib import Path

from crossmodal.maths.source_files import PACKAGE, source_files, sources_stamp


def named(paths: list[Path]) -> list[str]:
    return [path.relative_to(PACKAGE).as_posix() for path in paths]


def test_a_module_consists_of_itself_and_all_that_it_imports() -> None:
    found = named(source_files([PACKAGE / "maths/pinhole.py"]))
    assert found == ["maths/arrays.py", "maths/pinhole.py"]
    found = named(source_files([PACKAGE / "systems/ticks.py", PACKAGE / "maths/arrays.py"]))
    assert "maths/validation.py" in found
    assert found == sorted(set(found))


def test_what_a_function_imports_does_not_count_and_what_a_package_exports_does(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "import numpy\nfrom crossmodal.models import (\n    SDF_DIR,\n)\n"
        "def f():\n    from crossmodal.maths import se3\n"
    )
    found = set(source_files([path]))
    assert found == {path, PACKAGE / "models/__init__.py"}


def test_the_stamp_is_that_of_the_contents_wherever_they_lie(tmp_path: Path) -> None:
    path, copy, other = (tmp_path / name for name in ("module.py", "copy.py", "other.py"))
    path.write_text("import numpy\n")
    copy.write_text("import numpy\n")
    other.write_text("import numpy\n\n")
    assert sources_stamp(path) == sources_stamp(copy) != sources_stamp(other)
    other.write_text("from crossmodal.maths import se3\n")
    assert len({sources_stamp(path), sources_stamp(path, other), sources_stamp(other)}) == 3
