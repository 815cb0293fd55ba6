"""Compiled code is kept on the disk until a file that it was made from changes.

Numba keeps it in `__pycache__`, or in the user's cache folder where that is read-only, with a stamp
of the file that a function is in. A function that it calls, or a constant, may come from another
file. Here the stamp covers all files that it imports, directly or not.
"""

import hashlib
import re
from functools import cache
from pathlib import Path

import numba
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

_ROOT = Path(__file__).parents[1]
_PACKAGES = ("maths.", "systems.")  # All that compile; no compiled function needs another package.
_IMPORT = re.compile(r"^(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


def _imported_files(source: str) -> list[Path]:
    names = set()
    for module, imported in _IMPORT.findall(source):
        names |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", imported))}
    ours = [name.replace(".", "/") + ".py" for name in names if f"{name}.".startswith(_PACKAGES)]
    return sorted(_ROOT / file for file in ours if (_ROOT / file).exists())


@cache
def _file_hash_and_imports(path: Path) -> tuple[bytes, list[Path]]:
    content = path.read_bytes()
    return hashlib.sha256(content).digest(), _imported_files(content.decode())


def sources_stamp(path: Path) -> str:
    """Hash of a Python file and of all that it imports from these packages, directly or not."""
    hashes: dict[Path, bytes] = {}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in hashes:
            hashes[file], imported = _file_hash_and_imports(file)
            waiting += imported
    digest = hashlib.sha256()
    for file in sorted(hashes):
        digest.update(hashes[file])
    return digest.hexdigest()


class _AllSources:
    """Mixed into one of Numba's locators, which says where the code of one function is kept."""

    _py_file: str

    def get_source_stamp(self) -> str:
        return sources_stamp(Path(self._py_file))


class InUserProvidedFolder(_AllSources, UserProvidedCacheLocator):
    pass


class InTree(_AllSources, InTreeCacheLocator):
    pass


class InUserFolder(_AllSources, UserWideCacheLocator):
    pass


def use() -> None:
    """Makes all functions that are declared from now on keep their code so."""
    own = [f"{__name__}.{c.__name__}" for c in (InUserProvidedFolder, InTree, InUserFolder)]
    classes = ",".join([*own, "IPythonCacheLocator", "ZipCacheLocator"])
    numba.config.CACHE_LOCATOR_CLASSES = classes  # type: ignore[attr-defined]
