"""The tool of a seed: what it is like, where it is held and how."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.maths.arrays import Array
from crossmodal.plants.tools.wiper import draw_wiper, wiper_sdf
from crossmodal.systems.sensors.randomness import make_generator


@dataclass(frozen=True, kw_only=True)
class ToolPlacement:
    """The tool as it is held at first, and where the finger waits.

    Attributes:
        model: SDF or URDF file, or the text of an SDF.
        X_WM: Pose of the model's frame.
        thickness: Of what the hand holds, [m].
        texture: In models/sdf/textures.
        X_HandleE: Pose of the hand's end-effector in the tool's frame `handle`.
        X_EdgeS: Pose of the fingertip in the tool's frame `edge`, where it waits.
        X_EdgeTouch: Likewise, once its pad touches the edge.
    """

    model: Path | str
    X_WM: RigidTransform
    thickness: float
    texture: str
    X_HandleE: RigidTransform
    X_EdgeS: RigidTransform
    X_EdgeTouch: RigidTransform


def draw_tool(scenario: Scenario, reach: float) -> ToolPlacement:
    """The tool of the scenario's seed.

    Args:
        reach: Of the fingertip's pad from its centre, [m].
    """
    tool, finger, vary = scenario.tool, scenario.finger, scenario.tool.variation
    rng = make_generator(scenario.seed, "tool")
    half = rng.uniform(-1.0, 1.0, 10)
    R_EdgeS = _FINGER @ _by_hand(scenario)
    angles = np.deg2rad(vary.angles * half[:3])
    texture = str(rng.choice(vary.textures)) if vary.textures else ""
    wiper = draw_wiper(tool.wiper, make_generator(scenario.seed, "wiper"))
    model: Path | str = Path(tool.model) if tool.model else wiper_sdf(wiper)
    placed = finger.placement * half[7:10]
    p_EdgeTouch = np.array([0.0, finger.along_edge, -reach])
    before = R_EdgeS @ np.array([0.0, -reach - finger.clearance, 0.0])
    p_EdgeS = np.array([0.0, finger.along_edge, 0.0]) + before + placed
    return ToolPlacement(
        model=model,
        X_WM=RigidTransform(RollPitchYaw(angles), tool.position + vary.position * half[3:6]),
        thickness=wiper.bar if tool.thickness is None else tool.thickness,
        texture=texture,
        X_HandleE=RigidTransform(_HAND, np.array([0.0, 0.0, vary.grip * half[6]])),
        X_EdgeS=RigidTransform(R_EdgeS, p_EdgeS),
        X_EdgeTouch=RigidTransform(_FINGER, p_EdgeTouch),
    )


def _by_hand(scenario: Scenario) -> RotationMatrix:
    """How the finger is turned against the edge: about any axis, by up to the scenario's angle."""
    rng = make_generator(scenario.seed, "finger")
    axis = rng.standard_normal(3)
    angle = np.deg2rad(scenario.finger.rotation) * rng.uniform(0.0, 1.0)
    return RotationMatrix(AngleAxis(angle, axis / np.linalg.norm(axis)))


def _rotation(x: Array, y: Array) -> RotationMatrix:
    return RotationMatrix(np.column_stack([x, y, np.cross(x, y)]))


# The hand comes along y of the handle; its fingers are behind the bar, the thumb is before it.
_HAND = _rotation(np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
# The finger lies along the edge, against its y; its pad looks up to the edge.
_FINGER = _rotation(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
