"""Finds the files that a model names, and takes none from elsewhere.

A model may come from a stranger, and its copy goes where the run goes. What it takes along lies
beside it, in its package, or in a folder that the user has named by an environment variable.
"""

import os
import tempfile
from pathlib import Path

from PIL import Image
from trimesh.resolvers import FilePathResolver

_PATH_VARIABLES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "GAZEBO_MODEL_PATH",
                   "GZ_SIM_RESOURCE_PATH")  # fmt: skip
_MANIFESTS = ("package.xml", "model.config")  # Of a ROS package, of a Gazebo model.


class ModelFiles:
    """The files that belong to a model.

    Those of its package: the nearest folder above it that holds a `package.xml` or `model.config`.
    Without one they are those of the folder around its own, as in `urdf/` beside `meshes/`, unless
    that is everybody's: the home folder, the one for temporary files, or one above them.

    Args:
        source: The model.
    """

    def __init__(self, source: Path) -> None:
        self._source = source
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
        the folders of the usual environment variables.

        Args:
            base: Folder of the file that names it.
            element: What names it, for the message.

        Raises:
            ValueError: in one line, where there is none, or it is not the model's.
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
        found = [candidate.resolve() for candidate in candidates if candidate.exists()]
        for path in found:
            if self.holds(path):
                return path
        if found:
            raise ValueError(
                f"{self._source}: {element} '{uri}': lies outside the model's folder and its"
                " package; put it beside the model"
            )
        hint = "; put the package beside the model or into ROS_PACKAGE_PATH" if separator else ""
        raise ValueError(f"{self._source}: {element} '{uri}': there is no such file{hint}")

    def holds(self, path: Path) -> bool:
        """Whether a real path is that of a file of the model."""
        return any(path.is_relative_to(root) for root in self._roots)

    def _in_packages(self, rest: str, base: Path) -> list[Path]:
        package, _, inside = rest.partition("/")
        ancestors = [base.resolve(), *base.resolve().parents]
        around = [folder / package for folder in ancestors]
        for folder in around:
            if any((folder / manifest).exists() for manifest in _MANIFESTS):
                self._roots += _home_of(folder)
        around = [folder / inside for folder in around]
        for folder in self._named:
            around += [folder / package / inside, folder / "share" / package / inside]
            if folder.name == package:
                around.append(folder / inside)
        # A package whose folder has another name, such as a download's.
        return around + [folder / inside for folder in ancestors[:4]]


def is_image(path: Path) -> bool:
    """Whether a file holds a picture, whatever its name says."""
    try:
        with Image.open(path) as image:
            image.load()
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
    return True


class MeshFiles(FilePathResolver):
    """Gives trimesh the files that a mesh names, if they belong to the model."""

    def __init__(self, files: ModelFiles, folder: Path) -> None:
        super().__init__(str(folder))
        self._files, self._folder = files, folder

    def get(self, name: str) -> bytes:
        """The content of a file; raises a ValueError for one that is not the model's."""
        for candidate in (self._folder / name.strip(), self._folder / Path(name.strip()).name):
            path = candidate.resolve()
            if path.is_file() and self._files.holds(path):
                return path.read_bytes()
        raise ValueError(f"there is no file '{name.strip()}' that belongs to the model")

    def namespaced(self, namespace: str) -> "MeshFiles":
        """The same in a folder below."""
        return MeshFiles(self._files, self._folder / namespace)


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
