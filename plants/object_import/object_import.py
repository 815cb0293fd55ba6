"""Imports an articulated object from any SDF or URDF file."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex, FixedOffsetFrame, Frame, FrameIndex, Joint, RigidBody
from pydrake.systems.framework import DiagramBuilder

from crossmodal.plants.object_import import COPIED_FOLDERS, MODEL_FILE
from crossmodal.plants.object_import.flat_model import (
    DENSITY,
    Chain,
    FlatModelWriter,
    FlatNames,
    find_chain,
    flat_names,
    parent_joints,
)
from crossmodal.plants.object_import.meshes import Warn
from crossmodal.plants.object_import.model_source import ModelSource, Repair, read_model

_FILES = ("uri", "{drake.mit.edu}diffuse_map")  # Elements that name files in a copy.
_REFUSALS = (RuntimeError, ValueError, SystemExit)  # The last one by demands of Drake that fail.


@dataclass(kw_only=True)
class ImportedObject:
    """What an import made.

    Attributes:
        model: The written SDF: one model, links, joints and frames by their own names.
        joint: Name of the explored joint in it.
        grasp_frame: Name of the grasped frame in it.
        is_floating: Whether the file fixes nothing of the object to the world.
        warnings: What was changed or assumed, a line each.
    """

    model: Path
    joint: str
    grasp_frame: str
    is_floating: bool
    warnings: list[str]


def import_object(
    source: Path, folder: Path, *, grasp_frame: str, joint: str = "", scale: float = 1.0
) -> ImportedObject:
    """Writes a self-contained copy of a model that the simulation takes.

    The copy is `object.sdf` in `folder`, with its meshes (OBJ) and textures beside it. Of several
    models in a file it holds the one that the grasped frame belongs to. What the copy's collision
    geometry touches while it is grasped is rigid and hydroelastic; the object does not collide with
    itself, its joints' limits hold it together. Masses that are not given come from the geometry,
    at 600 kg/m^3 (wood).

    Args:
        source: SDF or URDF. The copy of such a copy is that itself.
        folder: Where the copy goes; made where it is missing.
        grasp_frame: A frame or link of the model, x out of the object, y along the bar; or
            `NAME@x,y,z,roll,pitch,yaw`, a pose in it, [m] and [rad].
        joint: The joint to explore; by default the nearest moving one above the grasped link.
        scale: Of all lengths in the file, so 0.001 for one in millimetres. `grasp_frame` is in
            metres.

    Raises:
        ValueError: in one line that says what to change, for what cannot be converted.
    """
    warnings: list[str] = []
    model = read_model(source)

    def warn(line: str) -> None:
        if line not in warnings:
            warnings.append(line)

    folder.mkdir(parents=True, exist_ok=True)
    wanted, at, pose = grasp_frame.partition("@")
    Repair(source, folder.resolve() / "meshes", warn, scale).run(model)
    plant, scene_graph = parse(model, source, folder.resolve())
    frame = _find_frame(plant, flat_names(plant), wanted, source)
    if at:
        frame = plant.AddFrame(FixedOffsetFrame("grasp", frame, _offset(pose, grasp_frame)))
    parent_joints(plant, source)
    names = flat_names(plant)  # Before Drake adds frames of its own.
    finalize(plant, source)
    chain = find_chain(plant, frame.body(), source, warn)
    explored = _find_joint(plant, names, chain, joint, grasp_frame, source, warn)
    imported = ImportedObject(
        model=folder / MODEL_FILE,
        joint=names.joints[int(explored.index())],
        grasp_frame=names.frames.get(int(frame.index()), names.bodies[int(frame.body().index())]),
        is_floating=chain.is_floating,
        warnings=warnings,
    )
    if any(model.masses.get(body.name(), 1.0) is None for body in chain.bodies):
        warn(f"masses that the file does not give are those of the geometry at {DENSITY:g} kg/m^3")
    X_WM = _model_pose(plant, frame.body(), chain)
    writer = FlatModelWriter(plant, scene_graph, model, chain, names, X_WM, folder.resolve(), warn)
    sdf = writer.element()
    comment = "".join(f"     {line}\n" for line in (f"Imported from {source.name}", *warnings))
    text = ElementTree.tostring(sdf, encoding="unicode")
    # Within a comment XML allows no two dashes in a row.
    header = f'<?xml version="1.0"?>\n<!--\n{re.sub("-(?=-)", "- ", comment)}-->\n'
    imported.model.write_text(f"{header}{text}\n", encoding="utf-8")
    given = read_model(source).root
    if _alike(given, ElementTree.fromstring(text)) and _is_whole(given, source.parent.resolve()):
        imported.model = source  # It is such a copy, and stays the same to the last digit.
    return imported


def _is_whole(model: Element, folder: Path) -> bool:
    """Whether all files that a model names are such as an import writes, and where it does."""
    for node in model.iter():
        if node.tag in _FILES:
            path = folder / (node.text or "")
            own = [folder / name for name in COPIED_FOLDERS]
            if path.resolve().parent not in own or path.suffix not in (".obj", ".png"):
                return False
            if not path.is_file():
                return False
    return True


def _alike(first: Element, second: Element) -> bool:
    """Whether two models say the same but for rounding (of colours, too) and names of files."""
    if first.tag != second.tag or len(first) != len(second):
        return False
    if first.tag in _FILES:
        return True
    if first.attrib.keys() != second.attrib.keys():
        return False
    texts = [(first.text, second.text)]
    texts += [(first.get(key), second.get(key)) for key in first.attrib]
    return all(_says_the_same(*both) for both in texts) and all(map(_alike, first, second))


def _says_the_same(first: str | None, second: str | None) -> bool:
    words = (first or "").split(), (second or "").split()
    if words[0] == words[1]:
        return True
    try:
        one, other = (np.array(each, dtype=float) for each in words)
    except ValueError:
        return False
    return len(one) == len(other) and np.allclose(one, other, rtol=1e-6, atol=1e-9)


def parse(model: ModelSource, source: Path, folder: Path) -> tuple[MultibodyPlant, SceneGraph]:
    """The model alone in a plant.

    Raises:
        ValueError: in one line, for what Drake's parser does not take.
    """
    # Couplings of joints need the SAP solver and a discrete plant.
    config = MultibodyPlantConfig(time_step=0.001, discrete_contact_approximation="sap")
    plant, scene_graph = AddMultibodyPlant(config, DiagramBuilder())
    repaired = folder / f".repaired{model.suffix}"
    ElementTree.ElementTree(model.root).write(repaired, encoding="unicode")
    try:
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        parser.AddModels(str(repaired))
    except _REFUSALS as error:
        reason = " ".join(str(error).replace(str(repaired), source.name).split())
        raise ValueError(f"{source}: cannot be parsed: {reason}") from None
    finally:
        repaired.unlink()
    return plant, scene_graph


def finalize(plant: MultibodyPlant, source: Path) -> None:
    """Ends the making of a plant.

    Raises:
        ValueError: in one line, where the model cannot be simulated.
    """
    try:
        plant.Finalize()
    except _REFUSALS as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{source}: cannot be simulated: {reason}") from None


def _find_frame(plant: MultibodyPlant, names: FlatNames, wanted: str, source: Path) -> Frame:
    links = {
        name: plant.get_body(BodyIndex(index)).body_frame() for index, name in names.bodies.items()
    }
    frames = {name: plant.get_frame(FrameIndex(index)) for index, name in names.frames.items()}
    for name, frame in {**frames, **links}.items():
        if wanted and (wanted == name or _scoped(plant, frame).endswith(f"::{wanted}")):
            return frame
    listed = f"frames: {_listed(frames)}; links: {_listed(links)}"
    if not wanted:
        raise ValueError(
            f"{source}: which frame is grasped? Name it by --grasp-frame, or in a scenario by"
            " objects.NAME.handle_frame"
            f" (x out of the object, y along the bar; NAME@x,y,z,roll,pitch,yaw is a pose in one);"
            f" {listed}"
        )
    raise ValueError(f"{source}: has no frame or link '{wanted}'; {listed}")


def _offset(pose: str, grasp_frame: str) -> RigidTransform:
    try:
        values = [float(part) for part in pose.split(",")]
    except ValueError:
        values = []
    if len(values) != 6 or not np.all(np.isfinite(values)):
        raise ValueError(
            f"{grasp_frame}: behind the @ must stand x,y,z,roll,pitch,yaw, [m] and [rad]"
        )
    return RigidTransform(RollPitchYaw(values[3:]), values[:3])


def _find_joint(
    plant: MultibodyPlant,
    names: FlatNames,
    chain: Chain,
    wanted: str,
    grasp_frame: str,
    source: Path,
    warn: Warn,
) -> Joint:
    moving = {names.joints[int(joint.index())]: joint for joint in chain.joints}
    if not moving:
        raise ValueError(
            f"{source}: no prismatic or revolute joint with travel moves '{grasp_frame}'; choose a"
            " frame on a link that moves"
        )
    name = wanted or next(iter(moving))
    for own_name, joint in moving.items():
        if wanted and _scoped(plant, joint).endswith(f"::{wanted}"):
            name = own_name
    if name not in moving:
        known = names.joints.values()
        what = "does not move" if name in known else "is no joint of the model, none that moves"
        raise ValueError(
            f"{source}: joint '{wanted}' {what} '{grasp_frame}'; those that do: {_listed(moving)}"
        )
    if len(moving) > 1:
        warn(
            f"'{grasp_frame}' is moved by {_listed(moving)}; '{name}' is explored, the truth of its"
            " axis is that of the start"
        )
    return moving[name]


def _model_pose(plant: MultibodyPlant, grasped: RigidBody, chain: Chain) -> RigidTransform:
    """Pose X_WM of the frame that places the object: its model's, or its root link's in a URDF."""
    context = plant.CreateDefaultContext()
    top = plant.GetModelInstanceName(grasped.model_instance()).split("::")[0]
    instance = plant.GetModelInstanceByName(top)
    if plant.HasFrameNamed("__model__", instance):
        return plant.GetFrameByName("__model__", instance).CalcPoseInWorld(context)
    return plant.EvalBodyPoseInWorld(context, chain.root)


def _scoped(plant: MultibodyPlant, element: Frame | Joint) -> str:
    """The element's name behind those of the models that it is nested in."""
    return f"{plant.GetModelInstanceName(element.model_instance())}::{element.name()}"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
