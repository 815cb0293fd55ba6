"""A tool with a flap on a hinge: what every one of them has."""

from pathlib import Path

import numpy as np
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RevoluteJoint

from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.plants.tools.wiper import EDGE_FRAME, HANDLE_FRAME, HINGE


def check_tool(model: Path | str) -> None:
    """Refuses a tool that has no hinge, no handle to hold it by or no edge to turn it by.

    The edge has to be on the flap, its x the way in which the hinge's positive sense turns it.

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
    flap, edge = joint.child_body(), plant.GetFrameByName(EDGE_FRAME, tool)
    if edge.body().index() != flap.index():
        raise ValueError(
            f"{what}: the frame '{EDGE_FRAME}' is on '{edge.body().name()}', need it on"
            f" '{flap.name()}', which the hinge turns"
        )
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_WJ, X_WF = (f.CalcPoseInWorld(context) for f in (joint.frame_on_child(), edge))
    lever = X_WF.translation() - X_WJ.translation()
    way = np.cross(X_WJ.rotation() @ joint.revolute_axis(), lever)
    if not way @ X_WF.rotation().matrix()[:, 0] > 0.0:
        raise ValueError(
            f"{what}: the hinge turns the frame '{EDGE_FRAME}' against its x; turn the axis or the"
            " frame round"
        )


def make_touchable(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex
) -> None:
    """Lets the fingertip's soft skin press on shapes whose file says nothing of contact.

    Args:
        plant: With the tool, finalized.
        scene_graph: Its geometry.
        instance: The tool.
    """
    inspector = scene_graph.model_inspector()
    for index in plant.GetBodyIndices(instance):
        for shape in plant.GetCollisionGeometriesForBody(plant.get_body(index)):
            properties = ProximityProperties(inspector.GetProximityProperties(shape))
            if properties.HasProperty("hydroelastic", "compliance_type"):
                continue
            AddRigidHydroelasticProperties(resolution_hint=1.0, properties=properties)
            scene_graph.AssignRole(plant.get_source_id(), shape, properties, RoleAssign.kReplace)
