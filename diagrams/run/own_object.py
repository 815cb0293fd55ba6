"""What a command line says about an object of the user's own, in place of a scenario's."""

from dataclasses import dataclass
from pathlib import Path

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


@dataclass(kw_only=True)
class OwnObject:
    """What the command line says about an object of the user's own.

    Attributes:
        model: SDF or URDF file.
        grasp_frame: Frame or link of it, x out of the object, y along the bar.
        joint: The joint to explore; empty for the nearest one above the grasped link.
        pull_direction: In the grasped frame, as `x,y,z`; empty for x.
        pose: Of the model's frame in the world, as `x,y,z,roll,pitch,yaw`, [m, rad], with every
            seed; empty puts the grasped frame where the handle of the scenario's own object is, or
            as much above as keeps the object out of the table; a free object stands on the table.
        scale: Of all lengths in the file: 0.001 for a model in millimetres.
    """

    model: Path
    grasp_frame: str = ""
    joint: str = ""
    pull_direction: str = ""
    pose: str = ""
    scale: float = 1.0


def refuse_without_object(**options: str) -> None:
    """Raises a ScenarioError for options that say something about no object."""
    for name, value in options.items():
        if value:
            raise ScenarioError(
                f"--{name.replace('_', '-')} {value}: is about the object that --object FILE names;"
                f" in a scenario it is a key below object"
            )
