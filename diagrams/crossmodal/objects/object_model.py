"""Reads an articulated object's model alone, to see whether it has what a scenario names."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion
from crossmodal.plants.parsing import make_parser
from crossmodal.systems.port_values import MOVING_TYPES, JointType


@dataclass(kw_only=True)
class ObjectModel:
    """What a model alone says about the explored joint and the handle.

    Attributes:
        joint_type: Prismatic, revolute or screw.
        lower: Least position of the joint, [m or rad].
        upper: Its largest.
        X_OH: Pose of the handle's frame in the model's, all joints at zero.
        lever: Distance of the handle from the axis that the joint turns about, [m]; 0 for a
            prismatic one.
        way_H: Unit vector (3,) in the handle's frame: where the handle goes from zero towards the
            joint's farther limit; zero for one on a revolute joint's axis.
        twist_H: Of the handle in its own frame (6,), rotation first, per unit of the joint's motion
            towards its farther limit, [rad] and [m] per [m or rad].
        two_ways: Whether both limits are equally far, or there are none.
        bottom: Height of its lowest point that can be touched in the model's frame, [m].
    """

    joint_type: JointType
    lower: float
    upper: float
    X_OH: RigidTransform
    lever: float
    way_H: np.ndarray
    twist_H: np.ndarray
    two_ways: bool
    bottom: float

    @property
    def unit(self) -> str:
        """Of the joint's position."""
        return "m" if self.joint_type == JointType.PRISMATIC else "rad"


def read_object_model(model: Path, *, joint: str, frame: str, source: str) -> ObjectModel:
    """Raises a ScenarioError unless the model can be read and has the joint and the frame."""
    plant, scene_graph, instance = parse_alone(model, source)
    joints = [plant.get_joint(index).name() for index in plant.GetJointIndices(instance)]
    if joint not in joints:
        raise ScenarioError(
            f"{source}.joint: {model.name} has no joint '{joint}'; {suggestion(joint, joints)}"
        )
    frames = [plant.get_frame(index).name() for index in plant.GetFrameIndices(instance)]
    if frame not in frames:
        raise ScenarioError(
            f"{source}.handle_frame: {model.name} has no frame '{frame}';"
            f" {suggestion(frame, filter(None, frames))}"
        )
    kind = plant.GetJointByName(joint, instance).type_name()
    if kind not in MOVING_TYPES:
        raise ScenarioError(
            f"{source}.joint: '{joint}' is a {kind} joint; allowed: {', '.join(MOVING_TYPES)}"
        )
    return _facts(plant, scene_graph, instance, joint, frame)


def parse_alone(model: Path, source: str) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """A model in a plant of its own, which is not finalized yet."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    parser = make_parser(plant)
    try:
        instances = parser.AddModels(str(model))
    except (RuntimeError, ValueError, SystemExit) as error:
        raise ScenarioError(f"{source}.model: cannot be read: {one_line(error)}") from None
    if len(instances) != 1:
        raise ScenarioError(f"{source}.model = '{model}' holds {len(instances)} models, need one")
    return plant, scene_graph, instances[0]


def _facts(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    instance: ModelInstanceIndex,
    joint_name: str,
    frame: str,
) -> ObjectModel:
    plant.Finalize()
    context = plant.CreateDefaultContext()
    joint = plant.GetJointByName(joint_name, instance)
    handle = plant.GetFrameByName(frame, instance)
    X_OH = handle.CalcPose(context, plant.GetFrameByName("__model__", instance))
    parent = joint.frame_on_parent()
    plant.SetVelocities(context, np.eye(plant.num_velocities())[joint.velocity_start()])
    V_JH_H = handle.CalcSpatialVelocity(context, parent, handle)  # Per unit of q.
    way, lever = V_JH_H.translational(), 0.0
    turn = np.linalg.norm(V_JH_H.rotational())
    if turn > 0.0:
        lever = float(np.linalg.norm(np.cross(V_JH_H.rotational() / turn, way)))
    rate = float(np.linalg.norm(way))
    way_H = way / rate if rate > 1e-6 else np.zeros(3)
    lower, upper = (
        float(limits[0])
        for limits in (joint.position_lower_limits(), joint.position_upper_limits())
    )
    farther = 1.0 if upper >= -lower else -1.0
    return ObjectModel(
        joint_type=JointType(joint.type_name()),
        lower=lower,
        upper=upper,
        X_OH=X_OH,
        lever=lever,
        way_H=way_H * farther,
        twist_H=V_JH_H.get_coeffs() * farther,
        two_ways=upper == -lower,
        bottom=_bottom(plant, scene_graph, instance),
    )


def _bottom(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> float:
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    X_OW = plant.GetFrameByName("__model__", instance).CalcPoseInWorld(context).inverse()
    heights = [0.0]
    for body in map(plant.get_body, plant.GetBodyIndices(instance)):
        X_OB = X_OW @ plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            box = inspector.GetObbInGeometryFrame(geometry)
            if box is not None:
                X_OX = X_OB @ inspector.GetPoseInFrame(geometry) @ box.pose()
                reach = np.abs(X_OX.rotation().matrix()[2]) @ box.half_width()
                heights.append(float(X_OX.translation()[2] - reach))
    return min(heights)
