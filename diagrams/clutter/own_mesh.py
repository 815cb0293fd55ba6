"""Meshes that do not come with the program: on the command line, and in a run's folder."""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from crossmodal.diagrams.clutter.scenario import GOODS_DIR, Scenario, target_name
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.plants.goods.mesh_model import write_mesh_model
from crossmodal.systems.pose.target_model import read_mesh

MODEL_FOLDER = "model"  # Of a run, for the copy of the mesh.


def own_mesh_assignments(
    base: Scenario, source: str, own: OwnObject, assignments: Sequence[str] = ()
) -> list[str]:
    """The assignments `key.path=value` that put a user's mesh in place of the scenario's object.

    Raises:
        ScenarioError: for what a mesh does not have.
    """
    for option, value in (
        ("grasp-frame", own.grasp_frame),
        ("joint", own.joint),
        ("pull-direction", own.pull_direction),
        ("object-pose", own.pose),
    ):
        if value:
            raise ScenarioError(
                f"--{option} {value}: '{source}' seeks a rigid object, of which only its mesh and"
                " --scale are asked"
            )
    if not own.model.is_file():
        raise ScenarioError(f"--object {own.model}: there is no such file")
    return [f"target.mesh={own.model.resolve()}", f"target.scale={own.scale}"]


def keep_files(scenario: Scenario) -> tuple[Scenario, dict[str, Path]]:
    """The scenario with its own mesh below `model` of a run's folder, and the mesh's file."""
    if not scenario.target.mesh:
        return scenario, {}
    mesh = Path(scenario.target.mesh)
    target = replace(scenario.target, mesh=f"{MODEL_FOLDER}/{mesh.name}")
    return replace(scenario, target=target), {f"{MODEL_FOLDER}/{mesh.name}": mesh}


def simulated_model(scenario: Scenario) -> Path:
    """The SDF file of the object; one made of the user's mesh is there as long as this process."""
    target = scenario.target
    if target.mesh:
        return _made(Path(target.mesh), target.scale, target.mass)
    name = target_name(scenario)
    return GOODS_DIR / name / f"{name}.sdf"


def target_mass(scenario: Scenario) -> float:
    """Of the object, which estimators know with its shape, [kg]."""
    if scenario.target.mesh:
        return scenario.target.mass
    model = ElementTree.parse(simulated_model(scenario)).getroot()
    return float(model.findtext("model/link/inertial/mass", default=""))


@cache
def _made(mesh: Path, scale: float, mass: float) -> Path:
    vertices, triangles = read_mesh(mesh)
    folder = Path(tempfile.mkdtemp(dir=_store().name))
    return write_mesh_model(vertices * scale, triangles, "target", mass, folder)


@cache
def _store() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="crossmodal-meshes-")
