"""Reads an articulated object's model alone, to see whether it has what a scenario names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from diagrams.yaml_schema import ScenarioError, one_line, suggestion
from plants.robot import add_package
from systems.port_values import JointType


def check_object_model(model: Path, *, joint: str, frame: str, source: str) -> JointType:
    """Raises a ScenarioError unless the model can be read and has the joint and the frame.

    Returns:
        The joint's type.
    """
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    add_package(parser)
    try:
        instances = parser.AddModels(str(model))
    except (RuntimeError, ValueError) as error:
        raise ScenarioError(f"{source}: object.model: cannot be read: {one_line(error)}") from None
    if len(instances) != 1:
        raise ScenarioError(
            f"{source}: object.model = '{model}' holds {len(instances)} models, need one"
        )
    instance = instances[0]
    joints = _names(plant.GetJointIndices, plant.get_joint, instance)
    if joint not in joints:
        raise ScenarioError(
            f"{source}: object.joint: {model.name} has no joint '{joint}';"
            f" {suggestion(joint, joints)}"
        )
    frames = _names(plant.GetFrameIndices, plant.get_frame, instance)
    if frame not in frames:
        raise ScenarioError(
            f"{source}: object.handle_frame: {model.name} has no frame '{frame}';"
            f" {suggestion(frame, frames)}"
        )
    kind = plant.GetJointByName(joint, instance).type_name()
    if kind not in (JointType.PRISMATIC, JointType.REVOLUTE):
        raise ScenarioError(
            f"{source}: object.joint: '{joint}' is a {kind} joint; allowed: prismatic, revolute"
        )
    return JointType(kind)


def _names(
    indices: Callable[[ModelInstanceIndex], list[Any]],
    element: Callable[[Any], Any],
    instance: ModelInstanceIndex,
) -> list[str]:
    return [element(index).name() for index in indices(instance) if element(index).name()]
