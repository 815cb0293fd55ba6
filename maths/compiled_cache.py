"""Compiled code is kept on the disk until a file that it was made from changes.

Numba keeps it in `__pycache__`, or in the user's cache folder where that is read-only, with a stamp
of the file that a function is in. But a function that it calls, a type or a constant may come from
another file. Here a folder for each module is named by the contents of all files that the module
imports, directly or not.
"""

import hashlib
import re
import shutil
from functools import cache
from pathlib import Path

import numba
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("crossmodal.maths.", "crossmodal.systems.")  # Only these compile.
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
    return digest.hexdigest()[:16]


class _AllSources:
    """Mixed into one of Numba's locators, which says where the code of one function is kept."""

    _py_file: str

    def get_cache_path(self) -> str:
        path = Path(self._py_file)
        folder: str = super().get_cache_path()  # type: ignore[misc]
        return str(Path(folder, f"{path.stem}-{sources_stamp(path)}"))

    def ensure_cache_path(self) -> None:
        """Makes the folder, and removes those that are of earlier contents."""
        path = Path(self.get_cache_path())
        if not path.exists():
            name, _, stamp = path.name.rpartition("-")
            for earlier in path.parent.glob(f"{name}-{'?' * len(stamp)}"):
                shutil.rmtree(earlier, ignore_errors=True)
        super().ensure_cache_path()  # type: ignore[misc]


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
