"""Reads model files into a plant, each under a name of its own."""

from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from crossmodal.models import SDF_DIR


def make_parser(plant: MultibodyPlant) -> Parser:
    """A parser for which `package://crossmodal/...` names the files in `models/sdf`."""
    parser = Parser(plant)
    parser.package_map().Add("crossmodal", str(SDF_DIR))
    return parser


def add_model(parser: Parser, file: Path | str, name: str) -> ModelInstanceIndex:
    """Adds the one model of a file under `name`, so that a file may serve several times.

    Args:
        parser: Of the plant.
        file: SDF or URDF file, or the text of an SDF.
        name: Of the model instance.

    Raises:
        ValueError: if the file has not one model, or the plant has another one of that name.
    """
    plant = parser.plant()
    source = file if isinstance(file, Path) else f"model '{name}'"
    if plant.HasModelInstanceNamed(name):
        raise ValueError(f"{source}: the plant already has a model named '{name}'")
    parser.SetAutoRenaming(True)  # The file's own name for the model may be taken.
    if isinstance(file, Path):
        instances = parser.AddModels(str(file))
    else:
        instances = parser.AddModelsFromString(file, "sdf")
    parser.SetAutoRenaming(False)
    if len(instances) != 1:
        names = [plant.GetModelInstanceName(instance) for instance in instances]
        raise ValueError(f"{source}: need one model, found {names}")
    if plant.GetModelInstanceName(instances[0]) != name:
        plant.RenameModelInstance(instances[0], name)
    return instances[0]


def find_model(plant: MultibodyPlant, name: str) -> ModelInstanceIndex:
    """The model instance of that name.

    Raises:
        ValueError: if there is none; it lists those that there are.
    """
    if not plant.HasModelInstanceNamed(name):
        indices = map(ModelInstanceIndex, range(plant.num_model_instances()))
        known = ", ".join(plant.GetModelInstanceName(index) for index in indices)
        raise ValueError(f"no model named '{name}' in the plant; there are {known}")
    return plant.GetModelInstanceByName(name)
