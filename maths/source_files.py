"""Which files of this package a Python file consists of: itself and all that it imports.

Only imports that a module makes when it is imported count. What a function imports, such as a plot
that it draws, is left out.
"""

import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(r"^(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@cache
def _hash_and_imports(path: Path) -> tuple[bytes, list[Path]]:
    content = path.read_bytes()
    names = set()
    for module, imported in _IMPORT.findall(content.decode()):
        names |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", imported))}
    places = [PACKAGE.parent / name.replace(".", "/") for name in names]
    files = [file for place in places for file in (place.with_suffix(".py"), place / "__init__.py")]
    found = [file for file in files if file.is_relative_to(PACKAGE) and file.is_file()]
    return hashlib.sha256(content).digest(), found


def source_files(paths: Iterable[Path]) -> list[Path]:
    """These Python files and all of this package's that they import, directly or not."""
    found, waiting = set(), list(paths)
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting += _hash_and_imports(file)[1]
    return sorted(found)


def sources_stamp(*paths: Path) -> str:
    """Hash of the contents, wherever they lie, of these files and of all that they import."""
    hashes = sorted(_hash_and_imports(file)[0] for file in source_files(paths))
    return hashlib.sha256(b"".join(hashes)).hexdigest()[:16]
