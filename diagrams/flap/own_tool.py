"""Tools that do not come with the program: on the command line, and in a run's folder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.models import SDF_DIR

MODEL_FOLDER = "model"  # Of a run, for the copy of the tool.


def own_tool_assignments(
    base: Scenario, source: str, own: OwnObject, assignments: Sequence[str] = ()
) -> list[str]:
    """The assignments `key.path=value` that put a user's tool in place of the drawn wiper.

    Raises:
        ScenarioError: for what a tool does not have.
    """
    for option, value in (
        ("grasp-frame", own.grasp_frame),
        ("joint", own.joint),
        ("pull-direction", own.pull_direction),
        ("object-pose", own.pose),
        ("scale", "" if own.scale == 1.0 else own.scale),
    ):
        if value:
            raise ScenarioError(
                f"--{option} {value}: '{source}' holds a tool by its frame 'handle' and turns its"
                " joint 'hinge' by its frame 'edge'; name them so in its file"
            )
    if not own.model.is_file():
        raise ScenarioError(f"--object {own.model}: there is no such file")
    return [f"tool.model={own.model.resolve()}"]


def tool_files(model: Path) -> list[Path]:
    """The model's file and those that it names, beside it or below.

    Raises:
        ScenarioError: for one that is elsewhere, which a run's folder could not hold.
    """
    from crossmodal.plants.object_import.model_source import read_model  # Slow: trimesh.

    try:
        root = read_model(model).root
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    names = []
    for node in root.iter():
        tag = str(node.tag).rpartition("}")[2]  # Without its namespace.
        names.append(node.get("filename"))
        names.append(node.text if tag == "uri" or tag.endswith("_map") else None)
    found = [model]
    for name in (name.strip() for name in names if name and name.strip()):
        if name.startswith("package://crossmodal/"):
            continue
        path = (model.parent / name).resolve()
        if not (path.is_file() and path.is_relative_to(model.parent.resolve())):
            raise ScenarioError(f"{model}: names '{name}', which does not lie beside it")
        found.append(path)
    return list(dict.fromkeys(found))


def keep_files(scenario: Scenario) -> tuple[Scenario, dict[str, Path]]:
    """The scenario with its own tool below `model` of a run's folder, and the tool's files."""
    model = Path(scenario.tool.model)
    if not scenario.tool.model or model.is_relative_to(SDF_DIR):
        return scenario, {}
    files = {
        f"{MODEL_FOLDER}/{path.relative_to(model.parent.resolve()).as_posix()}": path
        for path in tool_files(model)
    }
    tool = replace(scenario.tool, model=f"{MODEL_FOLDER}/{model.name}")
    return replace(scenario, tool=tool), files
