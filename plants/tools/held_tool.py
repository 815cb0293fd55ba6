"""A tool with a flap on a hinge: what every one of them has."""

from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint

from plants.parsing import add_model, make_parser
from plants.tools.wiper import EDGE_FRAME, HANDLE_FRAME, HINGE


def check_tool(model: Path | str) -> None:
    """Refuses a tool that has no hinge, no handle to hold it by or no edge to turn it by.

    Args:
        model: Its file, or the text of an SDF.

    Raises:
        ValueError: in one line.
    """
    plant = MultibodyPlant(0.0)
    tool = add_model(make_parser(plant), model, "tool")
    what = str(model) if isinstance(model, Path) else "the tool"
    if not plant.HasJointNamed(HINGE, tool):
        raise ValueError(f"{what}: need a revolute joint named '{HINGE}', found none")
    joint = plant.GetJointByName(HINGE, tool)
    if not isinstance(joint, RevoluteJoint):
        raise ValueError(f"{what}: the joint '{HINGE}' is {joint.type_name()}, need a revolute one")
    for frame in (HANDLE_FRAME, EDGE_FRAME):
        if not plant.HasFrameNamed(frame, tool):
            raise ValueError(f"{what}: need a frame named '{frame}', found none")
