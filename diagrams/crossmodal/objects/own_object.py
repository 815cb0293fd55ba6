"""Objects that do not come with the program: imported when a scenario names them."""

import hashlib
import shutil
import tempfile
import warnings
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagrams.crossmodal.objects.object_model import ObjectModel, read_object_model
from diagrams.run.yaml_schema import ScenarioError
from plants.object_import import MODEL_FILE

if TYPE_CHECKING:
    from diagrams.crossmodal.scenario import Scenario
    from diagrams.crossmodal.station.station import ManipulationStation
    from plants.object_import.object_import import ImportedObject

MODEL_FOLDER = "model"  # Of a run, for the copies of imported objects.
_DEEPEST_OVERLAP = 0.005  # [m]
_WIDEST_PULL = 60.0  # From the way that the joint allows, [deg].


class ObjectWarning(UserWarning):
    """What an import changed or assumed."""


@dataclass(kw_only=True)
class OwnObject:
    """What the command line says about an object of the user's own.

    Attributes:
        model: SDF or URDF file.
        grasp_frame: Frame or link of it, x out of the object, y along the bar.
        joint: The joint to explore; empty for the nearest one above the grasped link.
        pull_direction: In the grasped frame, as `x,y,z`; empty for x.
        pose: Of the model's frame in the world, as `x,y,z,roll,pitch,yaw`, [m, rad]; empty puts
            the grasped frame where the handle of the scenario's own object is, or as much above as
            keeps the object out of the table; a free object stands on the table.
    """

    model: Path
    grasp_frame: str
    joint: str = ""
    pull_direction: str = ""
    pose: str = ""


def imported(model: Path, *, joint: str, frame: str, free: bool, source: str) -> "ImportedObject":
    """The imported copy of a model, in a folder that is there as long as this process is.

    A run takes it along into its own folder.

    Raises:
        ScenarioError: where the model cannot be converted.
    """
    from plants.object_import.object_import import import_object  # Slow: trimesh.

    store = Path(_store().name)
    with tempfile.TemporaryDirectory(dir=store) as scratch:
        folder = Path(scratch) / "model"
        try:
            result = import_object(model, folder, grasp_frame=frame, joint=joint)
        except ValueError as error:
            raise ScenarioError(f"{source}: {error}") from None
        if result.model.parent == folder:
            place = store / content_hash(folder)
            if not place.exists():
                folder.rename(place)
            result.model = place / MODEL_FILE
            if result.is_floating and not free:
                result.warnings.append(
                    "nothing fixes the model to the world, so its root is fixed there;"
                    " with object.free = true it rests on the table"
                )
    for line in result.warnings:
        warnings.warn(f"{model.name}: {line}", ObjectWarning, stacklevel=2)
    return result


@cache
def _store() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="crossmodal-objects-")


def content_hash(folder: Path) -> str:
    """Of all its files, wherever it is."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        digest.update(str(path.relative_to(folder)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def own_object_assignments(scenario: "Scenario", source: str, own: OwnObject) -> list[str]:
    """The assignments `key.path=value` that put an own object in place of a scenario's.

    Friction becomes what the scenario's is at the hand, and the opening asked for what the joint's
    limits allow.

    Args:
        scenario: The one whose object is replaced, with the user's assignments.
        source: Its name or file.
    """
    from diagrams.crossmodal.scenario import object_model_file

    base, thing = scenario, scenario.object
    name = scenario.task.object or next(iter(scenario.objects))
    at_base = read_object_model(
        object_model_file(thing), joint=thing.joint, frame=thing.handle_frame, source=source
    )
    made = imported(
        own.model,
        joint=own.joint,
        frame=own.grasp_frame,
        free=thing.free,
        source="--object",
    )
    facts = read_object_model(made.model, joint=made.joint, frame=made.grasp_frame, source="")
    pull = _numbers("--pull-direction", own.pull_direction or "1,0,0", 3)
    pulling = thing.friction / (at_base.lever if at_base.lever else 1.0)
    values: dict[str, object] = {
        "model": str(made.model.resolve()),
        "joint": made.joint,
        "handle_frame": made.grasp_frame,
        "pull_direction": pull,
        "friction": float(pulling * facts.lever if facts.lever else pulling),
        "variation.textures": [],
    }
    if own.pose:
        pose = _numbers("--object-pose", own.pose, 6)
        angles = np.rad2deg(pose[3:]).tolist()
        values |= dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
        values |= {"place_handle": False, "position": pose[:3]}
    else:
        X_WH = thing.pose() @ at_base.X_OH
        x_axis = X_WH.rotation().col(0)
        # It stands no lower than the scenario's own object, or it would be inside the table; one
        # that is free stands there, or it would fall.
        sway = thing.variation.position
        low_base = at_base.bottom - at_base.X_OH.translation()[2]
        p_WH = X_WH.translation()
        lift = float(low_base - facts.bottom + facts.X_OH.translation()[2])
        if thing.free:
            values["variation.position"] = [*sway[:2].tolist(), 0.0]
        else:
            lift = max(0.0, lift + float(sway[2]))
        values |= {
            "place_handle": True,
            "position": [*p_WH[:2].tolist(), float(p_WH[2]) + lift],
            "yaw": float(np.rad2deg(np.arctan2(x_axis[1], x_axis[0]))),
        }
    lines = [f"objects.{name}.{key}={value}" for key, value in values.items()]
    most = 0.9 * max(abs(facts.lower), abs(facts.upper))
    for key in ("opening", "goal"):
        wanted = getattr(base.task, key)
        if wanted is not None and wanted > most:
            lines.append(f"task.{key}={float(most)}")
    return lines


def refuse_without_object(**options: str) -> None:
    """Raises a ScenarioError for options that say something about no object."""
    for name, value in options.items():
        if value:
            raise ScenarioError(
                f"--{name.replace('_', '-')} {value}: is about the object that --object FILE names;"
                f" in a scenario it is a key below object"
            )


def _numbers(option: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise ScenarioError(f"{option} {text}: expected {count} numbers with commas between them")
    return values


def check_pull(facts: ObjectModel, pull_direction: np.ndarray, joint: str, frame: str) -> None:
    """Warns of a pull that hardly moves the joint: it wrenches the handle out of the hand."""
    if not np.any(facts.way_H):
        return
    along = float(facts.way_H @ pull_direction / np.linalg.norm(pull_direction))
    along = abs(along) if facts.two_ways else along
    angle = np.rad2deg(np.arccos(np.clip(along, -1.0, 1.0)))
    if angle > _WIDEST_PULL:
        given, better = (
            ",".join(f"{component + 0.0:.2g}" for component in np.round(vector, 2))
            for vector in (pull_direction, facts.way_H)
        )
        warnings.warn(
            f"the pull along {given} of '{frame}' is {angle:.0f} deg off the way that '{joint}'"
            f" lets it go, and may lose the handle; along it is {better} (--pull-direction or"
            " object.pull_direction)",
            ObjectWarning,
            stacklevel=2,
        )


def overlaps(station: "ManipulationStation") -> list[str]:
    """What of an object is inside something else at the start, by more than 5 mm, a line each."""
    scene, context = station.scene, station.diagram.CreateDefaultContext()
    station.SetInitialState(context)
    query = scene.scene_graph.get_query_output_port().Eval(
        scene.scene_graph.GetMyContextFromRoot(context)
    )
    objects = list(scene.objects.values())
    inspector, deepest = query.inspector(), dict[tuple[str, str], float]()
    for pair in query.ComputePointPairPenetration():
        bodies = [
            scene.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in (pair.id_A, pair.id_B)
        ]
        bodies.sort(key=lambda body: body.model_instance() not in objects)
        if bodies[0].model_instance() in objects and pair.depth > _DEEPEST_OVERLAP:
            names = bodies[0].name(), bodies[1].name()
            deepest[names] = max(deepest.get(names, 0.0), pair.depth)
    return [
        f"link '{link}' starts {100 * depth:.0f} cm inside '{other}'; place the object elsewhere"
        " (object.position)"
        for (link, other), depth in deepest.items()
    ]


def keep_object(model: Path, folder: Path) -> Path:
    """Copies an imported model with its meshes into a folder; returns the copy's SDF."""
    target = folder / MODEL_FILE
    if model.resolve() != target.resolve():
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(model.parent, folder)
    return target


def keep_files(scenario: "Scenario", folder: Path) -> "Scenario":
    """Copies imported models into a run's folder, below `model`, and names them there."""
    if not any(Path(thing.model).is_absolute() for thing in scenario.objects.values()):
        shutil.rmtree(folder / MODEL_FOLDER, ignore_errors=True)
    objects = {}
    for name, thing in scenario.objects.items():
        if Path(thing.model).is_absolute():
            place = MODEL_FOLDER if len(scenario.objects) == 1 else f"{MODEL_FOLDER}/{name}"
            kept = keep_object(Path(thing.model), folder / place)
            thing = replace(thing, model=str(kept.relative_to(folder)))
        objects[name] = thing
    return replace(scenario, objects=objects)


def identity(scenario: "Scenario") -> "Scenario":
    """Of an imported object it matters what it is, not where its copy lies."""
    objects = {
        name: replace(thing, model=content_hash(Path(thing.model).parent))
        if Path(thing.model).is_absolute()
        else thing
        for name, thing in scenario.objects.items()
    }
    return replace(scenario, objects=objects)
