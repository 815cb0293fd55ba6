"""Finds the files that a model names, and takes none from elsewhere.

A model may come from a stranger, and its copy goes where the run goes. What it takes along lies
beside it, in its package, or in a folder that the user has named by an environment variable.
"""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

from PIL import Image
from trimesh.resolvers import FilePathResolver

_PATH_VARIABLES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "GAZEBO_MODEL_PATH",
                   "GZ_SIM_RESOURCE_PATH")  # fmt: skip
_MANIFESTS = ("package.xml", "model.config")  # Of a ROS package, of a Gazebo model.


class MissingFileError(ValueError):
    """A model names a file that there is not."""


class ModelFiles:
    """The files that belong to a model.

    Those of its package: the nearest folder above it that holds a `package.xml` or `model.config`.
    Without one they are those of the folder around its own, as in `urdf/` beside `meshes/`, unless
    that is everybody's: the home folder, the one for temporary files, or one above them.

    Args:
        source: The model.
        warn: Takes a line for each file that is named in another way than it is written.
    """

    def __init__(self, source: Path, warn: Callable[[str], None]) -> None:
        self._source, self._warn = source, warn
        self._named = [
            Path(folder)
            for variable in _PATH_VARIABLES
            for folder in os.environ.get(variable, "").split(os.pathsep)
            if folder
        ]
        self._roots = [folder.resolve() for folder in self._named]
        for path in (source.absolute(), source.resolve()):
            self._roots += _home_of(path.parent)

    def find(self, uri: str, base: Path, element: str) -> Path:
        """The real path of the file that a URI names.

        `package://` and `model://` names are looked for in the folders around the file, then in
        the folders of the usual environment variables. Where there is none of that name, it may be
        percent-encoded, or in other upper and lower case, as on disks that tell none apart.

        Args:
            uri: The name.
            base: Folder of the file that names it.
            element: What names it, for the message.

        Raises:
            MissingFileError: in one line, where there is none.
            ValueError: in one line, where it is not the model's.
        """
        scheme, separator, rest = uri.partition("://")
        if not separator:
            candidates = [base / uri]
        elif scheme == "file":
            candidates = [Path(rest), base / rest]
        elif scheme in ("package", "model"):
            candidates = self._in_packages(rest, base)
        else:
            raise ValueError(
                f"{self._source}: {element} '{uri}': {scheme}:// is not supported; save the file"
                " beside the model and name it relatively"
            )
        found = [path.resolve() for path in candidates if _is_there(path)]
        if not found:
            alike = map(_differently_written, candidates)
            found = [path.resolve() for path in alike if path and _is_there(path)]
            for path in found[:1]:
                self._warn(f"{element} '{uri}': taken to be {path.name}, as it is written on disk")
        for path in found:
            if self.holds(path):
                return path
        if found:
            raise ValueError(
                f"{self._source}: {element} '{uri}': lies outside the model's folder and its"
                " package; put it beside the model"
            )
        into = "GZ_SIM_RESOURCE_PATH" if scheme == "model" else "ROS_PACKAGE_PATH"
        hint = f"; put its folder beside the model, or name that in {into}" if separator else ""
        raise MissingFileError(f"{self._source}: {element} '{uri}': there is no such file{hint}")

    def holds(self, path: Path) -> bool:
        """Whether a real path is that of a file of the model."""
        return any(path.is_relative_to(root) for root in self._roots)

    def _in_packages(self, rest: str, base: Path) -> list[Path]:
        package, _, inside = rest.partition("/")
        ancestors = [base.resolve(), *base.resolve().parents]
        # Gazebo's worlds have their models in such a folder beside or around them.
        beside = [folder / "models" for folder in ancestors[:4]]
        around = [folder / package for folder in (*ancestors, *beside)]
        for folder in around:
            if any((folder / manifest).exists() for manifest in _MANIFESTS):
                self._roots += _home_of(folder)
        around = [folder / inside for folder in around]
        for folder in self._named:
            around += [folder / package / inside, folder / "share" / package / inside]
            if folder.name == package:
                around.append(folder / inside)
        if inside:  # A package whose folder has another name, such as a download's.
            around += [folder / inside for folder in ancestors[:4]]
        return around


def _is_there(path: Path) -> bool:
    """Whether there is such a file or folder, and no pipe on which one would wait for ever."""
    return os.path.isfile(path) or os.path.isdir(path)


def _differently_written(path: Path) -> Path | None:
    """The file whose name is the same once it is decoded and in lower case; None for none."""
    found = Path(path.anchor)
    # A part that is decoded may have become several.
    parts = list(path.parts[len(found.parts) :])
    while parts:
        part = parts.pop(0)
        below = found / part
        if not os.path.exists(below) and "/" in unquote(part):
            parts[:0] = unquote(part).split("/")
            continue
        if not os.path.exists(below):
            try:
                names = sorted(os.listdir(found))
            except OSError:
                return None
            alike = {unquote(part).casefold(), part.casefold()}
            below = next((found / name for name in names if name.casefold() in alike), below)
            if not os.path.exists(below):
                return None
        found = below
    return found


def is_image(path: Path) -> bool:
    """Whether a file holds a picture, whatever its name says."""
    try:
        with Image.open(path) as image:
            image.load()
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
    return True


class MeshFiles(FilePathResolver):
    """Gives trimesh the files that a mesh names, if they belong to the model.

    Args:
        files: The model's.
        folder: Of the mesh.
        warn: Takes a line for each file that there is not.
        made: Contents of files that are not on disk, by their names.
    """

    def __init__(
        self,
        files: ModelFiles,
        folder: Path,
        warn: Callable[[str], None],
        made: dict[str, bytes] | None = None,
    ) -> None:
        super().__init__(str(folder))
        self._files, self._folder, self.warn = files, folder, warn
        self._made = made or {}

    def get(self, name: str) -> bytes:
        """The same as `read`; says so where there is none, for trimesh goes on without it."""
        try:
            return self.read(name)
        except ValueError as error:
            self.warn(f"{error}; left out")
            raise

    def read(self, name: str) -> bytes:
        """The content of a file; raises a ValueError for one that is not the model's.

        A name from another system may have backslashes, and a path that is not here; then the file
        may lie beside the mesh, or in a folder below that has the name of its last one.
        """
        if name in self._made:
            return self._made[name]
        parts = name.strip().strip("\"'").replace("\\", "/").split("/")
        for start in range(len(parts)):
            path = self._folder / "/".join(parts[start:])
            found = path if os.path.isfile(path) else _differently_written(path)
            if found is not None and os.path.isfile(found) and self._files.holds(found.resolve()):
                return found.resolve().read_bytes()
        raise ValueError(f"'{name.strip()}': there is no such file that belongs to the model")

    def with_made(self, name: str, content: bytes) -> "MeshFiles":
        """The same and one that is not on disk."""
        return MeshFiles(self._files, self._folder, self.warn, {**self._made, name: content})

    def namespaced(self, namespace: str) -> "MeshFiles":
        """The same in a folder below."""
        return MeshFiles(self._files, self._folder / namespace, self.warn, self._made)


def _home_of(folder: Path) -> list[Path]:
    """The folders of which all files belong to a model in `folder`, as real paths."""
    for ancestor in (folder, *folder.parents):
        for manifest in _MANIFESTS:
            if (ancestor / manifest).is_file():
                # Packages are installed as links to their files.
                return [ancestor.resolve(), (ancestor / manifest).resolve().parent]
    around = folder.resolve().parent
    everybodys = [Path.home().resolve(), Path(tempfile.gettempdir()).resolve()]
    if any(place.is_relative_to(around) for place in everybodys):
        return [folder.resolve()]
    return [folder.resolve(), around]
