"""The simulated world: robots, furniture and articulated objects in a MultibodyPlant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.common.schema import Transform
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    PerceptionProperties,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Joint, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.models import SDF_DIR
from crossmodal.plants.joint_friction import add_friction, connect_friction
from crossmodal.plants.parsing import add_model, find_model, make_parser

_WHITE = Rgba(1.0, 1.0, 1.0)


@dataclass(kw_only=True)
class PlantConfig:
    # Drake model directives of all but the objects, in models/sdf or by an absolute path.
    scene: str = "table_scene.dmd.yaml"
    # Step of the simulation.
    time_step: float = number(0.006, at_least=1e-4, at_most=0.1, unit="s")
    # Drake's discrete contact approximation. With `sap` a carton that slides on its table is borne
    # by 0 to 4 times its weight from step to step, with `lagged` by its weight.
    contact_approximation: str = "lagged"
    # Up to this slip a contact holds. At Drake's 1e-4 m/s the hand creeps: it turned by 24 deg
    # about a door's bar, by 19 deg at 1e-5 m/s, which takes no more time.
    stiction_tolerance: float = number(1e-5, at_least=1e-7, at_most=0.1, unit="m/s")


@dataclass(kw_only=True)
class ObjectPlacement:
    """One articulated object as it stands in the world.

    Attributes:
        model: SDF or URDF file, or the text of an SDF.
        X_WO: Pose of its model frame.
        free: Whether its root floats, to rest on the table or floor, or is welded to the world.
        friction: Coulomb friction of each of its joints of one degree of freedom.
        texture: PNG in models/sdf/textures for visuals whose names begin with `textured`.
    """

    model: Path | str
    X_WO: RigidTransform
    free: bool = False
    friction: float = number(0.0, at_least=0.0, at_most=1e4, unit="N or N m")
    texture: str = ""


@dataclass(kw_only=True)
class ManipulationScene:
    """The finalized plant and what others need to find their way in it.

    Attributes:
        plant: With robots, furniture and objects.
        scene_graph: Its geometry.
        objects: Model instance of each placed object, by its name.
        friction: Coulomb friction of each velocity of the plant (nv,), [N] or [N m].
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    objects: dict[str, ModelInstanceIndex]
    friction: Array

    def model(self, name: str) -> ModelInstanceIndex:
        """The model instance of that name: a robot's, an object's or a piece of furniture's."""
        return find_model(self.plant, name)

    def pose(self, frame: str, model: str) -> RigidTransform:
        """X_WF of a frame of a model while all joints are at their defaults."""
        found = self.plant.GetFrameByName(frame, self.model(model))
        return found.CalcPoseInWorld(self.plant.CreateDefaultContext())


def add_manipulation_scene(
    builder: DiagramBuilder,
    config: PlantConfig,
    objects: Mapping[str, ObjectPlacement],
    robots: Sequence[Sequence[str]],
    bases: Mapping[str, RigidTransform] | None = None,
    weightless: Sequence[str] = (),
) -> ManipulationScene:
    """Adds plant and scene graph to `builder`, the objects placed where they stand.

    Args:
        config: Of the plant; its directives hold the robots.
        objects: By name, which becomes the name of the model instance.
        robots: For each robot the names of its model instances, such as an arm and its hand. A
            robot does not collide with itself.
        bases: Where models truly stand that the directives weld to the world, by their names; those
            that are not named stand where the directives say.
        weightless: Models that feel no gravity: arms whose drives carry their own weight.

    Raises:
        ValueError: if `time_step` or a friction is impossible, a name is not known or not unique,
            or an object has not one root body.
    """
    check(config, "PlantConfig")
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=config.time_step,
            discrete_contact_approximation=config.contact_approximation,
            stiction_tolerance=config.stiction_tolerance,
        ),
        builder,
    )
    parser = make_parser(plant)
    directives = LoadModelDirectives(str(SDF_DIR / config.scene))
    for model, X_WBase in (bases or {}).items():
        _move_base(directives, model, X_WBase)
    ProcessModelDirectives(directives, parser)
    instances = {
        name: _place(plant, parser, name, placement) for name, placement in objects.items()
    }
    for name, placement in objects.items():
        for joint in object_joints(plant, instances[name]):
            if placement.friction > 0.0:
                add_friction(plant, joint, placement.friction)
    for name in weightless:
        plant.set_gravity_enabled(find_model(plant, name), False)
    plant.Finalize()
    for robot in robots:
        _ignore_self_collision(plant, scene_graph, [find_model(plant, name) for name in robot])
    friction = np.zeros(plant.num_velocities())
    for name, placement in objects.items():
        if placement.texture:
            _set_texture(plant, scene_graph, instances[name], placement.texture)
        connect_friction(builder, plant, instances[name])
        for joint in object_joints(plant, instances[name]):
            friction[joint.velocity_start()] = placement.friction
    return ManipulationScene(
        plant=plant,
        scene_graph=scene_graph,
        objects=instances,
        friction=friction,
    )


def has_model(scene: str, model: str) -> bool:
    """Whether model directives add a model of that name.

    Args:
        scene: File of directives in models/sdf, or an absolute path.
        model: Name of the model instance.
    """
    directives = LoadModelDirectives(str(SDF_DIR / scene)).directives
    return any(item.add_model is not None and item.add_model.name == model for item in directives)


def nominal_pose(scene: str, frame: str, model: str) -> RigidTransform:
    """X_WF of a frame of a model, as model directives place it, all joints at their defaults.

    Args:
        scene: File of directives in models/sdf, or an absolute path.
        frame: Its name.
        model: Name of the model instance.
    """
    plant = MultibodyPlant(time_step=0.0)
    ProcessModelDirectives(LoadModelDirectives(str(SDF_DIR / scene)), make_parser(plant))
    plant.Finalize()
    found = plant.GetFrameByName(frame, find_model(plant, model))
    return found.CalcPoseInWorld(plant.CreateDefaultContext())


def _move_base(directives: ModelDirectives, model: str, X_WBase: RigidTransform) -> None:
    """Lets the directives weld a model to the world somewhere else."""
    welds = [item.add_weld for item in directives.directives if item.add_weld is not None]
    found = [w for w in welds if w.parent == "world" and w.child.partition("::")[0] == model]
    if len(found) != 1:
        raise ValueError(f"the directives do not weld '{model}' to the world, once")
    found[0].X_PC = Transform(X_WBase)


def _place(
    plant: MultibodyPlant, parser: Parser, name: str, placement: ObjectPlacement
) -> ModelInstanceIndex:
    check(placement, f"ObjectPlacement of '{name}'")
    instance = add_model(parser, placement.model, name)
    joints = map(plant.get_joint, plant.GetJointIndices())
    children = [joint.child_body().index() for joint in joints]
    bodies = map(plant.get_body, plant.GetBodyIndices(instance))
    roots = [body for body in bodies if body.index() not in children]
    if len(roots) != 1:
        raise ValueError(
            f"object '{name}': need one root body, found {[body.name() for body in roots]}"
        )
    model_frame = plant.GetFrameByName("__model__", instance)
    if placement.free:
        X_OB = model_frame.GetFixedPoseInBodyFrame().inverse()
        plant.SetDefaultFloatingBaseBodyPose(roots[0], placement.X_WO @ X_OB)
    else:
        plant.WeldFrames(plant.world_frame(), model_frame, placement.X_WO)
    return instance


def position_index(plant: MultibodyPlant, joint: Joint) -> int:
    """Where a joint's position stands among those of its model alone."""
    joints = map(plant.get_joint, plant.GetJointIndices(joint.model_instance()))
    starts = [other.position_start() for other in joints if other.num_positions() > 0]
    return int(joint.position_start() - min(starts))


def object_joints(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[Joint]:
    """The joints of one degree of freedom between bodies of an object."""
    joints = (plant.get_joint(index) for index in plant.GetJointIndices(instance))
    world = plant.world_body().index()
    return [j for j in joints if j.num_velocities() == 1 and j.parent_body().index() != world]


def _ignore_self_collision(
    plant: MultibodyPlant, scene_graph: SceneGraph, robot: list[ModelInstanceIndex]
) -> None:
    """A robot does not collide with itself: its links overlap where they meet, and fingers that
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
                tint = properties.GetPropertyOrDefault("phong", "diffuse", _WHITE)
                if texture.startswith("plain_") and not tint.r() == tint.g() == tint.b():
                    # The picture is multiplied by this colour, but paint hides what is below.
                    properties.UpdateProperty("phong", "diffuse", _WHITE)
                scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)
                scene_graph.AssignRole(plant.get_source_id(), geometry, properties)


def facing(X_WO: RigidTransform) -> RigidTransform:
    """End-effector pose in front of a handle: z of E into the object, y of E along its y.

    `X_WO` has x out of the object.
    """
    R_OE = RotationMatrix(np.column_stack([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    return X_WO @ RigidTransform(R_OE, np.zeros(3))
