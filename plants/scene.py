"""The simulated world: the robot, furniture and one articulated object in a MultibodyPlant."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    PerceptionProperties,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import LoadModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Joint, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from maths.arrays import Array
from models import SDF_DIR
from plants.robots.wam import add_package


@dataclass(kw_only=True)
class PlantConfig:
    scene: str = "table_scene.dmd.yaml"  # Model directives in models/sdf, all but the object.
    time_step: float = 0.006  # [s]
    contact_approximation: str = "sap"  # Drake's discrete contact approximation.


@dataclass(kw_only=True)
class ObjectPlacement:
    """One articulated object as it stands in the world.

    Attributes:
        model: SDF or URDF file.
        X_WO: Pose of its model frame.
        free: Whether its root floats, to rest on the table or floor, or is welded to the world.
        friction: Coulomb friction of each of its joints, [N] or [N m].
        texture: PNG in models/sdf/textures for visuals whose names begin with `textured`.
    """

    model: Path
    X_WO: RigidTransform
    free: bool = False
    friction: float = 0.0
    texture: str = ""


@dataclass(kw_only=True)
class ManipulationScene:
    """The finalized plant and what others need to find their way in it."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    arm: ModelInstanceIndex
    hand: ModelInstanceIndex
    object: ModelInstanceIndex
    X_WBase: RigidTransform
    friction: Array = field(default_factory=lambda: np.zeros(0))  # Of each velocity (nv,).


def add_manipulation_scene(
    builder: DiagramBuilder, config: PlantConfig, placement: ObjectPlacement
) -> ManipulationScene:
    """Adds plant and scene graph to `builder`, the object placed where it stands.

    Raises:
        ValueError: if `time_step` is not positive or the object has not one root body.
    """
    if not config.time_step > 0:
        raise ValueError(f"PlantConfig: need time_step > 0 s, got {config.time_step!r}")
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=config.time_step,
            discrete_contact_approximation=config.contact_approximation,
        ),
        builder,
    )
    parser = Parser(plant)
    add_package(parser)
    ProcessModelDirectives(LoadModelDirectives(str(SDF_DIR / config.scene)), parser)
    (object_instance,) = parser.AddModels(str(placement.model))
    roots = [
        body
        for body in map(plant.get_body, plant.GetBodyIndices(object_instance))
        if not any(
            joint.child_body().index() == body.index()
            for joint in map(plant.get_joint, plant.GetJointIndices())
        )
    ]
    if len(roots) != 1:
        raise ValueError(
            f"{placement.model}: need one root body, found {[body.name() for body in roots]}"
        )
    model_frame = plant.GetFrameByName("__model__", object_instance)
    if placement.free:
        X_OB = model_frame.GetFixedPoseInBodyFrame().inverse()
        plant.SetDefaultFloatingBaseBodyPose(roots[0], placement.X_WO @ X_OB)
    else:
        plant.WeldFrames(plant.world_frame(), model_frame, placement.X_WO)
    plant.Finalize()
    arm, hand = (plant.GetModelInstanceByName(name) for name in ("arm", "hand"))
    _ignore_self_collision(plant, scene_graph, [arm, hand])
    if placement.texture:
        _set_texture(plant, scene_graph, object_instance, placement.texture)
    friction = np.zeros(plant.num_velocities())
    for joint in object_joints(plant, object_instance):
        start = joint.velocity_start()
        friction[start : start + joint.num_velocities()] = placement.friction
    return ManipulationScene(
        plant=plant,
        scene_graph=scene_graph,
        arm=arm,
        hand=hand,
        object=object_instance,
        X_WBase=plant.GetFrameByName("base", arm).CalcPoseInWorld(plant.CreateDefaultContext()),
        friction=friction,
    )


def object_joints(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[Joint]:
    """The joints between bodies of an object that can move."""
    joints = (plant.get_joint(index) for index in plant.GetJointIndices(instance))
    world = plant.world_body().index()
    return [j for j in joints if j.num_velocities() > 0 and j.parent_body().index() != world]


def _ignore_self_collision(
    plant: MultibodyPlant, scene_graph: SceneGraph, robot: list[ModelInstanceIndex]
) -> None:
    """The robot does not collide with itself: its links overlap where they meet, and fingers that
    curl side by side would cost as many contact surfaces as the handle does.
    """
    shapes = [
        shape
        for instance in robot
        for index in plant.GetBodyIndices(instance)
        for shape in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    ]
    declaration = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(shapes))
    scene_graph.collision_filter_manager().Apply(declaration)


def _set_texture(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex, texture: str
) -> None:
    path = SDF_DIR / "textures" / f"{texture}.png"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.png")))
        raise ValueError(f"no texture '{texture}' in {path.parent}; there are {known}")
    inspector = scene_graph.model_inspector()
    for index in plant.GetBodyIndices(instance):
        frame = plant.GetBodyFrameIdOrThrow(index)
        for geometry in inspector.GetGeometries(frame, Role.kPerception):
            if inspector.GetName(geometry).split("::")[-1].startswith("textured"):
                properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry))
                properties.UpdateProperty("phong", "diffuse_map", str(path))
                scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)
                scene_graph.AssignRole(plant.get_source_id(), geometry, properties)


def facing(X_WO: RigidTransform) -> RigidTransform:
    """End-effector pose in front of a handle: z of E into the object, y of E along its y.

    `X_WO` has x out of the object.
    """
    R_OE = RotationMatrix(np.column_stack([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    return X_WO @ RigidTransform(R_OE, np.zeros(3))
