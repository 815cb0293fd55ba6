"""Objects that do not come with the program: imported when a scenario names them."""

import hashlib
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crossmodal.diagrams.crossmodal.objects.object_model import ObjectModel
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.plants.object_import import COPIED_FOLDERS, MODEL_FILE

if TYPE_CHECKING:
    from crossmodal.plants.object_import.object_import import ImportedObject

ABOVE_FLOOR = 0.002  # So that nothing begins inside of it, [m].
FLOOR_SCENE = "floor_scene.dmd.yaml"  # Without a table.
WIDEST_PULL = 60.0  # From the way that the joint allows, [deg].


class ObjectWarning(UserWarning):
    """What an import changed or assumed."""


class PlaceWarning(ObjectWarning):
    """Where an object stands, and why not as the scenario's own does."""


def imported(
    model: Path, *, joint: str, frame: str, free: bool, source: str, scale: float = 1.0
) -> "ImportedObject":
    """The imported copy of a model, in a folder that is there as long as this process is.

    A run takes it along into its own folder.

    Raises:
        ScenarioError: where the model cannot be converted.
    """
    from crossmodal.plants.object_import.object_import import import_object  # Slow: trimesh.

    store = Path(_store().name)
    with tempfile.TemporaryDirectory(dir=store) as scratch:
        folder = Path(scratch) / "model"
        try:
            result = import_object(model, folder, grasp_frame=frame, joint=joint, scale=scale)
        except ValueError as error:
            raise ScenarioError(f"{source}: {error}") from None
        if result.model.parent == folder:
            place = store / content_hash(folder / MODEL_FILE)
            if not place.exists():
                folder.rename(place)
            result.model = place / MODEL_FILE
            if result.is_floating and not free:
                result.warnings.append(
                    "nothing fixes the model to the world, so its root is fixed there;"
                    " with objects.NAME.free = true it rests on the table"
                )
    for line in result.warnings:
        warnings.warn(f"{model.name}: {line}", ObjectWarning, stacklevel=2)
    return result


@cache
def _store() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="crossmodal-objects-")


def copied_files(model: Path) -> list[Path]:
    """The files of a copy that an import has written, and nothing else that lies beside it."""
    folder = model.parent.resolve()
    parts = [path for name in COPIED_FOLDERS for path in (folder / name).glob("*.*")]
    own = [path for path in parts if path.suffix in (".obj", ".mtl", ".png")]
    return [model, *sorted(path for path in own if path.resolve() == path and path.is_file())]


def content_hash(model: Path) -> str:
    """Of all files of a copy, wherever it is."""
    digest = hashlib.sha256()
    for path in copied_files(model):
        digest.update(str(path.resolve().relative_to(model.parent.resolve())).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def pull_error(facts: ObjectModel, pull_direction: np.ndarray) -> float:
    """Angle from a pull (3,) to the way that the joint lets the handle go, [deg]; 0 for no way."""
    if not np.any(facts.way_H):
        return 0.0
    along = float(facts.way_H @ pull_direction / np.linalg.norm(pull_direction))
    along = abs(along) if facts.two_ways else along
    return float(np.rad2deg(np.arccos(np.clip(along, -1.0, 1.0))))


def in_words(vector: np.ndarray) -> str:
    """A direction as `x,y,z`."""
    return ",".join(f"{component + 0.0:.2g}" for component in np.round(vector, 2))


def check_pull(facts: ObjectModel, pull_direction: np.ndarray, joint: str, frame: str) -> None:
    """Warns of a pull that hardly moves the joint: it wrenches the handle out of the hand."""
    angle = pull_error(facts, pull_direction)
    if angle > WIDEST_PULL:
        given, better = in_words(pull_direction), in_words(facts.way_H)
        warnings.warn(
            f"the pull along {given} of '{frame}' is {angle:.0f} deg off the way that '{joint}'"
            f" lets it go, and may lose the handle; along it is {better} (--pull-direction or"
            " objects.NAME.pull_direction)",
            ObjectWarning,
            stacklevel=2,
        )


def check_grasp(model: Path, frame: str, source: str) -> None:
    """Warns of a bar that the hand may not hold, and of looks that do not fit the touch."""
    from crossmodal.diagrams.crossmodal.objects.grasp_checks import model_warnings  # Slow: trimesh.

    for line in model_warnings(model, frame, source):
        warnings.warn(line, ObjectWarning, stacklevel=2)
