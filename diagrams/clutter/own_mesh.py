"""Meshes that do not come with the program: on the command line, and in a run's folder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

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
