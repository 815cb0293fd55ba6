"""Compiled code is kept on the disk until a file that it was made from changes.

Numba keeps it in `__pycache__`, or in the user's cache folder where that is read-only, with a stamp
of the file that a function is in. But a function that it calls, a type or a constant may come from
another file. Here a folder for each module is named by the contents of all files that the module
imports, directly or not.
"""

import shutil
from pathlib import Path

import numba
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

from crossmodal.maths.source_files import sources_stamp


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
