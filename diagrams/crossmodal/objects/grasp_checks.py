"""What of a user's object will not work, as far as its model alone shows it: a line each."""

from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from crossmodal.diagrams.crossmodal.objects.object_model import parse_alone
from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE, GraspRange
from crossmodal.plants.object_import.bars import bar_at, faults_of_bar
from crossmodal.plants.object_import.solids import bounds_overlap, shapes_of, solid_of, turned

_ALIKE, _UNLIKE = 0.8, 0.5  # Overlap of the bounds of what is seen and what is touched.
_QUARTER_TURNS = [
    RigidTransform(RotationMatrix(turn(sign * np.pi / 2)), np.zeros(3))
    for turn in (
        RotationMatrix.MakeXRotation,
        RotationMatrix.MakeYRotation,
        RotationMatrix.MakeZRotation,
    )
    for sign in (1, -1)
]


def model_warnings(model: Path, frame: str, source: str) -> list[str]:
    """What is wrong with the bar at the grasp frame, and with what is seen of the links."""
    plant, scene_graph, instance = parse_alone(model, source)
    plant.Finalize()
    inspector, context = scene_graph.model_inspector(), plant.CreateDefaultContext()
    grasp = plant.GetFrameByName(frame, instance)
    carried = plant.GetBodiesWeldedTo(grasp.body())
    solid = solid_of(plant, inspector, context, carried, grasp)
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    return [
        *grasp_faults(solid, frame, SOFT_HAND_RANGE),
        *(line for body in bodies for line in _turned_visual(plant, inspector, body)),
    ]


def grasp_faults(solid: trimesh.Trimesh, frame: str, can: GraspRange) -> list[str]:
    """Why a hand would not hold what is at a grasp frame; none where it holds it.

    Args:
        solid: What of the grasped link can be touched, in the grasp frame.
        frame: Its name.
        can: What the hand holds.
    """
    bar = None if solid.is_empty else bar_at(solid, can.reach)
    if bar is None:
        return [
            f"the grasp frame '{frame}' is in thin air: no collision geometry of its link within"
            f" {1e2 * can.reach:.0f} cm; put it into the bar"
            " (--grasp-frame LINK@x,y,z,roll,pitch,yaw)"
        ]
    faults = faults_of_bar(bar, can)
    return [f"the hand may not hold the bar at '{frame}': {fault}" for fault in faults]


def _turned_visual(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> list[str]:
    """Whether what is seen of a link would cover what is touched if it were turned by 90 deg."""
    seen = shapes_of(plant, body, visual=True)
    touched = shapes_of(plant, body, visual=False)
    if not seen or not touched:
        return []

    def bounds(shapes: list, X_GG: RigidTransform) -> np.ndarray:
        points = np.concatenate([turned(inspector, shape, X_GG) for shape in shapes])
        return np.array([points.min(axis=0), points.max(axis=0)])

    goal = bounds(touched, RigidTransform())
    if bounds_overlap(bounds(seen, RigidTransform()), goal) >= _UNLIKE:
        return []
    if max(bounds_overlap(bounds(seen, turn), goal) for turn in _QUARTER_TURNS) < _ALIKE:
        return []
    return [
        f"link '{body.name()}': what is seen is turned by 90 deg against what is touched; glTF and"
        " GLB have y up, so turn the visual's <origin> or <pose>, or export the mesh with y up"
    ]
