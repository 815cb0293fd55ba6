"""One flat SDF model of the part of a parsed plant that belongs to the grasped link."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    Rgba,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    CalcSpatialInertia,
    ForceElementIndex,
    Frame,
    FrameIndex,
    Joint,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    ScrewJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.meshes import (
    Warn,
    encloses_volume,
    opacity_in,
    write_png,
)
from crossmodal.plants.object_import.model_source import ModelSource
from crossmodal.plants.screw_axis import screw_axis

DENSITY = 600.0  # Of wood, for links whose mass the file does not give, [kg/m^3].
_HULL_DENSITY = 150.0  # Of the hull of a mesh that encloses nothing: a hollow thing, [kg/m^3].
_LEAST_MASS, _LEAST_RADIUS = 1e-3, 0.03  # Of a link without geometry, [kg], gyration [m].
_UNLIMITED = 1e6  # Larger limits are none, [m] or [rad].
_DRAKE = "drake:"


@dataclass(kw_only=True)
class Chain:
    """How the grasped link hangs on the root.

    Attributes:
        root: The body that stands.
        joints: The moving joints from the grasped link to the root, the nearest first.
        bodies: All bodies of the object.
        gripped: Those that are rigidly fixed to the grasped link.
        is_floating: Whether nothing fixes the root to the world.
    """

    root: RigidBody
    joints: list[Joint]
    bodies: list[RigidBody]
    gripped: list[RigidBody]
    is_floating: bool


@dataclass(kw_only=True)
class FlatNames:
    """Names within the written model, by index in the plant."""

    joints: dict[int, str] = field(default_factory=dict)
    bodies: dict[int, str] = field(default_factory=dict)
    frames: dict[int, str] = field(default_factory=dict)


def moves(joint: Joint) -> bool:
    """Whether a joint moves in the copy; others are held."""
    return _can_move(joint) and has_travel(joint)


def has_travel(joint: Joint) -> bool:
    """Whether its limits leave it any: models hold bodies by hinges from 0 to 0."""
    return bool(np.all(joint.position_lower_limits() < joint.position_upper_limits()))


def _can_move(joint: Joint) -> bool:
    return isinstance(joint, PrismaticJoint | RevoluteJoint | ScrewJoint)


def start_position(joint: Joint) -> float:
    """Where a joint stands in the copy, which calls it 0: at 0, or at the limit next to it."""
    lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
    return float(np.clip(0.0, lower, upper))


def written_joints(plant: MultibodyPlant) -> list[Joint]:
    """The joints of the file, without those that the plant makes for free bodies."""
    joints = (plant.get_joint(index) for index in plant.GetJointIndices())
    return [joint for joint in joints if "floating" not in joint.type_name()]


def links(plant: MultibodyPlant) -> list[RigidBody]:
    """All bodies but the world."""
    return [plant.get_body(BodyIndex(index)) for index in range(1, plant.num_bodies())]


def flat_names(plant: MultibodyPlant) -> FlatNames:
    """A name for each joint, body and named frame, unique in one model; the joints' come first.

    A name that occurs twice gets its model's name in front.
    """
    names, used = FlatNames(), set[str]()
    joints, bodies = written_joints(plant), links(plant)
    auxiliary = {
        int(frame.index()) for j in joints for frame in (j.frame_on_parent(), j.frame_on_child())
    }
    body_frames = {int(body.body_frame().index()) for body in bodies}
    frames = [
        frame
        for frame in (plant.get_frame(FrameIndex(i)) for i in range(plant.num_frames()))
        if int(frame.index()) not in body_frames
        and not frame.name().startswith("__")
        and not (int(frame.index()) in auxiliary and frame.name().endswith(("_parent", "_child")))
        and frame.name() not in ("", "world")
    ]
    for elements, into in ((joints, names.joints), (bodies, names.bodies), (frames, names.frames)):
        for element in elements:
            model = plant.GetModelInstanceName(element.model_instance()).replace("::", ".")
            name = element.name().replace("::", ".")
            kind = "link" if into is names.bodies else "frame"
            for candidate in (name, f"{model}.{name}", f"{name}_{kind}"):
                if candidate not in used:
                    break
            used.add(candidate)
            into[int(element.index())] = candidate
    return names


def parent_joints(plant: MultibodyPlant, source: Path) -> dict[int, Joint]:
    """The joint that each body hangs on, by the body's index.

    Raises:
        ValueError: in one line, for a link with two parents, or joints in a closed loop.
    """
    parents: dict[int, Joint] = {}
    for joint in written_joints(plant):
        child = int(joint.child_body().index())
        if child in parents:
            raise ValueError(
                f"{source}: link '{joint.child_body().name()}' is the child of two joints,"
                f" '{parents[child].name()}' and '{joint.name()}'; remove one of them"
            )
        parents[child] = joint
    for joint in parents.values():
        loop = list(islice(joints_above(joint.child_body(), parents), len(parents) + 1))
        if len(loop) > len(parents):
            closed = loop[-1 - loop[-2::-1].index(loop[-1]) :]
            names = ", ".join(joint.name() for joint in closed)
            raise ValueError(f"{source}: joints {names} form a closed loop; remove one of them")
    return parents


def joints_above(body: RigidBody, parents: Mapping[int, Joint]) -> Iterator[Joint]:
    """The joints that a body hangs on, the nearest first.

    Args:
        body: Any.
        parents: Of `parent_joints`.
    """
    while int(body.index()) in parents:
        joint = parents[int(body.index())]
        yield joint
        body = joint.parent_body()


def find_chain(plant: MultibodyPlant, grasped: RigidBody, source: Path, warn: Warn) -> Chain:
    """The object that the grasped link belongs to, and the joints that move this link.

    Raises:
        ValueError: in one line, for a joint above the grasped link that is of another kind.
    """
    world, parents = plant.world_body(), parent_joints(plant, source)
    path = list(joints_above(grasped, parents))
    for joint in path:
        if joint.num_velocities() and not _can_move(joint):
            raise ValueError(
                f"{source}: joint '{joint.name()}', which moves link '{grasped.name()}', is a"
                f" {joint.type_name().split('_')[0]} joint; the grasped link may move on prismatic,"
                " revolute and screw joints only, so change its type"
            )
    root = path[-1].parent_body() if path else grasped
    held = root.index() == world.index()
    # Joints that hang on the world move something, so the world itself becomes the root.
    hangs_on_world = held and moves(path[-1])
    if held and not hangs_on_world:
        root = path[-1].child_body()
    bodies = []
    for body in links(plant):
        above = [joint.parent_body().index() for joint in joints_above(body, parents)]
        of_another_file = hangs_on_world and _top_model(plant, body) != _top_model(plant, grasped)
        if root.index() in [body.index(), *above] and not of_another_file:
            bodies.append(body)
    left_out = [
        body.scoped_name().get_full()
        for body in links(plant)
        if int(body.index()) not in {int(chosen.index()) for chosen in bodies}
        and plant.GetVisualGeometriesForBody(body) + plant.GetCollisionGeometriesForBody(body)
    ]
    if left_out:
        warn(f"not joined to the grasped link and left out: {', '.join(left_out)}")
    carrier = _carrier(grasped, parents)
    gripped = [body for body in bodies if _carrier(body, parents) == carrier]
    joints = [joint for joint in path if moves(joint)]
    return Chain(root=root, joints=joints, bodies=bodies, gripped=gripped, is_floating=not held)


def _top_model(plant: MultibodyPlant, body: RigidBody) -> str:
    return str(plant.GetModelInstanceName(body.model_instance())).split("::")[0]


def _carrier(body: RigidBody, parents: Mapping[int, Joint]) -> BodyIndex:
    """The highest body below the world that a body is rigidly fixed to."""
    for joint in joints_above(body, parents):
        if moves(joint) or int(joint.parent_body().index()) == 0:
            break
        body = joint.parent_body()
    return body.index()


class FlatModelWriter:
    """Writes the flat model.

    Args:
        plant: Finalized.
        scene_graph: Its geometry.
        source: What the XML said beyond the plant.
        chain: What belongs to the object.
        names: In the written model.
        X_WM: Pose of the written model's frame.
        folder: Of the written model; textures are copied into it.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        source: ModelSource,
        chain: Chain,
        names: FlatNames,
        X_WM: RigidTransform,
        folder: Path,
        warn: Warn,
    ) -> None:
        self._plant, self._source, self._chain, self._names = plant, source, chain, names
        self._inspector: SceneGraphInspector = scene_graph.model_inspector()
        self._context: Context = plant.CreateDefaultContext()
        plant.SetPositions(self._context, self._start_positions())
        self._X_WM, self._folder, self._warn = X_WM, folder, warn
        self._textures: dict[str, str] = {}
        self._translucent = list[str]()

    def _start_positions(self) -> Array:
        """All joints where they start; free bodies where the file puts them."""
        q = self._plant.GetPositions(self._context)
        for joint in map(self._plant.get_joint, self._plant.GetJointIndices()):
            if _can_move(joint):
                q[joint.position_start()] = start_position(joint)
        return np.asarray(q)

    def element(self) -> Element:
        """The <sdf> element."""
        sdf = Element("sdf", {"version": "1.9", "xmlns:drake": "drake.mit.edu"})
        # The model's frame belongs to its canonical link, and it is welded to the world.
        root_name = self._body_name(self._chain.root)
        model = SubElement(sdf, "model", {"name": "object", "canonical_link": root_name})
        if int(self._chain.root.index()) == 0:
            self._add_root(model)
        for body in self._chain.bodies:
            self._add_link(model, body)
        chosen = {int(body.index()) for body in self._chain.bodies}
        above = chosen | {int(self._chain.root.index())}
        joints = [
            joint
            for joint in written_joints(self._plant)
            if int(joint.child_body().index()) in chosen
            and int(joint.parent_body().index()) in above
        ]
        if self._translucent:
            self._warn(
                "translucent, so that colour is of what is behind and depth is not, and vision may"
                f" claim what is wrong: {', '.join(self._translucent)}"
            )
        leaders = {joint.name(): joint for joint in joints}
        for joint in joints:
            self._add_joint(model, joint, leaders)
        for index, frame_name in self._names.frames.items():
            frame = self._plant.get_frame(FrameIndex(index))
            if int(frame.body().index()) in chosen:
                self._add_frame(model, frame, frame_name)
        group = SubElement(model, f"{_DRAKE}collision_filter_group", {"name": "object"})
        for body in self._chain.bodies:
            SubElement(group, f"{_DRAKE}member").text = self._names.bodies[int(body.index())]
        SubElement(group, f"{_DRAKE}ignored_collision_filter_group").text = "object"
        ElementTree.indent(sdf)
        return sdf

    def _body_name(self, body: RigidBody) -> str:
        return "root" if int(body.index()) == 0 else self._names.bodies[int(body.index())]

    def _add_root(self, model: Element) -> None:
        link = SubElement(model, "link", {"name": "root"})
        _add_pose(link, self._X_WM.inverse())
        _add_inertia(link, 1.0, np.zeros(3), 0.01 * np.eye(3))

    def _add_link(self, model: Element, body: RigidBody) -> None:
        name = self._body_name(body)
        link = SubElement(model, "link", {"name": name})
        X_WB = self._plant.EvalBodyPoseInWorld(self._context, body)
        _add_pose(link, self._X_WM.inverse() @ X_WB)
        shapes = self._plant.GetCollisionGeometriesForBody(body)
        if body.name() in self._source.masses:
            inertia = self._inertia_of_shapes(shapes, self._source.masses[body.name()])
        else:
            inertia = body.default_spatial_inertia()
        p_BBcm = inertia.get_com()
        central = inertia.Shift(p_BBcm).CalcRotationalInertia().CopyToFullMatrix3()
        _add_inertia(link, inertia.get_mass(), p_BBcm, central)
        for number, geometry in enumerate(self._plant.GetVisualGeometriesForBody(body)):
            self._add_visual(link, geometry, f"visual_{number}")
        is_gripped = any(other.index() == body.index() for other in self._chain.gripped)
        for number, geometry in enumerate(shapes):
            self._add_collision(link, geometry, f"collision_{number}", is_gripped)

    def _inertia_of_shapes(
        self, shapes: Iterable[GeometryId], mass: float | None
    ) -> SpatialInertia:
        total = SpatialInertia.Zero()
        for geometry in shapes:
            X_BG = self._inspector.GetPoseInFrame(geometry)
            M_GG = _spatial_inertia(self._inspector.GetShape(geometry))
            total += M_GG.ReExpress(X_BG.rotation()).Shift(-X_BG.translation())
        if total.get_mass() <= 0:
            round_ = UnitInertia(*[_LEAST_RADIUS**2] * 3)
            return SpatialInertia(mass or _LEAST_MASS, np.zeros(3), round_)
        return SpatialInertia(mass or total.get_mass(), total.get_com(), total.get_unit_inertia())

    def _add_visual(self, link: Element, geometry: GeometryId, name: str) -> None:
        element = SubElement(link, "visual", {"name": name})
        _add_pose(element, self._inspector.GetPoseInFrame(geometry))
        shape = self._inspector.GetShape(geometry)
        self._add_shape(element, shape)
        if isinstance(shape, Mesh):
            look = Path(shape.source().path()).with_suffix(".mtl")
            if look.exists():  # The mesh has its own look.
                self._note_glass(link, opacity_in(look))
                return
        properties = self._inspector.GetPerceptionProperties(geometry)
        if properties is None:
            properties = self._inspector.GetIllustrationProperties(geometry)
        color = properties.GetPropertyOrDefault("phong", "diffuse", Rgba(0.6, 0.6, 0.6, 1.0))
        texture = properties.GetPropertyOrDefault("phong", "diffuse_map", "")
        self._note_glass(link, 1.0 if texture else color.a())
        material = SubElement(element, "material")
        SubElement(material, "diffuse").text = _text([1.0] * 4 if texture else list(color.rgba))
        if texture:
            SubElement(material, f"{_DRAKE}diffuse_map").text = self._copied(texture)

    def _note_glass(self, link: Element, opacity: float) -> None:
        name = link.get("name", "")
        if opacity < 1.0 and name not in self._translucent:
            self._translucent.append(name)

    def _copied(self, texture: str) -> str:
        """Name of a texture's copy relative to the model."""
        if texture not in self._textures:
            name = f"textures/{len(self._textures)}_{Path(texture).stem}.png"
            (self._folder / "textures").mkdir(exist_ok=True)
            write_png(Path(texture), self._folder / name)
            self._textures[texture] = name
        return self._textures[texture]

    def _add_collision(
        self, link: Element, geometry: GeometryId, name: str, is_gripped: bool
    ) -> None:
        element = SubElement(link, "collision", {"name": name})
        _add_pose(element, self._inspector.GetPoseInFrame(geometry))
        self._add_shape(element, self._inspector.GetShape(geometry))
        properties = SubElement(element, f"{_DRAKE}proximity_properties")
        given = self._inspector.GetProximityProperties(geometry)
        if is_gripped or isinstance(self._inspector.GetShape(geometry), Mesh):
            # Others touch the hull of a mesh, which also fills what is in front of a handle.
            SubElement(properties, f"{_DRAKE}rigid_hydroelastic")
            SubElement(properties, f"{_DRAKE}mesh_resolution_hint").text = "0.012"
        usual = 1.0 if is_gripped else 0.5
        static = dynamic = usual
        if given.HasProperty("material", "coulomb_friction"):
            friction = given.GetProperty("material", "coulomb_friction")
            static, dynamic = friction.static_friction(), friction.dynamic_friction()
        SubElement(properties, f"{_DRAKE}mu_static").text = repr(static)
        SubElement(properties, f"{_DRAKE}mu_dynamic").text = repr(dynamic)

    def _add_shape(self, element: Element, shape: Shape) -> None:
        geometry = SubElement(element, "geometry")
        if isinstance(shape, Mesh | Convex):
            mesh = SubElement(geometry, "mesh")
            path = Path(shape.source().path())
            SubElement(mesh, "uri").text = str(path.relative_to(self._folder.resolve()))
            return
        sizes: dict[str, list[float]]
        if isinstance(shape, Box):
            tag, sizes = "box", {"size": list(shape.size())}
        elif isinstance(shape, Sphere):
            tag, sizes = "sphere", {"radius": [shape.radius()]}
        elif isinstance(shape, Ellipsoid):
            tag, sizes = "ellipsoid", {"radii": [shape.a(), shape.b(), shape.c()]}
        else:
            assert isinstance(shape, Cylinder | Capsule)
            tag = "cylinder" if isinstance(shape, Cylinder) else "capsule"
            sizes = {"radius": [shape.radius()], "length": [shape.length()]}
        inner = SubElement(geometry, tag)
        for key, values in sizes.items():
            SubElement(inner, key).text = _text(values)

    def _add_joint(self, model: Element, joint: Joint, leaders: dict[str, Joint]) -> None:
        kind, is_fixed = joint.type_name(), not moves(joint)
        name = self._names.joints[int(joint.index())]
        if is_fixed:
            kind = "fixed"
            if not has_travel(joint):
                self._warn(f"joint '{name}' has limits without travel, so it is held fixed")
            elif joint.num_velocities():
                self._warn(
                    f"joint '{name}' is a {joint.type_name()} joint and is held fixed;"
                    " prismatic, revolute and screw joints move"
                )
        element = SubElement(model, "joint", {"name": name, "type": kind})
        X_BM = joint.frame_on_child().CalcPoseInBodyFrame(self._context)
        _add_pose(element, X_BM)
        SubElement(element, "parent").text = self._body_name(joint.parent_body())
        SubElement(element, "child").text = self._body_name(joint.child_body())
        if is_fixed:
            return
        axis = SubElement(element, "axis")
        SubElement(axis, "xyz").text = _text(self._axis(joint))
        if isinstance(joint, ScrewJoint):
            SubElement(element, "screw_thread_pitch").text = repr(float(joint.screw_pitch()))
        limit = SubElement(axis, "limit")
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        start = start_position(joint)
        if start != 0.0:
            self._warn(
                f"joint '{name}': its limits {lower:g} to {upper:g} leave out 0, so it starts at"
                f" {start:g}, and positions are counted from there"
            )
        if lower > -_UNLIMITED:
            SubElement(limit, "lower").text = repr(float(lower - start))
        if upper < _UNLIMITED:
            SubElement(limit, "upper").text = repr(float(upper - start))
        SubElement(limit, "effort").text = "0"  # No motor.
        dynamics = SubElement(axis, "dynamics")
        SubElement(dynamics, "damping").text = repr(float(joint.default_damping_vector()[0]))
        self._add_spring(dynamics, joint)
        mimic = self._source.mimics.get(joint.name())
        if mimic is not None and mimic.leader not in leaders:
            self._warn(f"joint '{name}' mimics '{mimic.leader}', which there is not; it is free")
        elif mimic is not None and not moves(leaders[mimic.leader]):
            self._warn(f"joint '{name}' mimics '{mimic.leader}', which does not move; it is free")
        elif mimic is not None:
            leader = leaders[mimic.leader]
            led = self._names.joints[int(leader.index())]
            # Positions are counted from the start, those of both joints.
            offset = mimic.offset + mimic.multiplier * start_position(leader) - start
            values = {"multiplier": repr(mimic.multiplier), "offset": repr(offset)}
            SubElement(element, f"{_DRAKE}mimic", {"joint": led, **values})

    def _axis(self, joint: Joint) -> Array:
        if isinstance(joint, PrismaticJoint):
            return joint.translation_axis()
        if isinstance(joint, RevoluteJoint):
            return joint.revolute_axis()
        return screw_axis(self._plant, joint)

    def _add_spring(self, dynamics: Element, joint: Joint) -> None:
        for index in range(self._plant.num_force_elements()):
            spring = self._plant.get_force_element(ForceElementIndex(index))
            if isinstance(spring, RevoluteSpring):
                rest, stiffness = spring.default_nominal_angle(), spring.GetStiffness(self._context)
            elif isinstance(spring, PrismaticSpring):
                rest, stiffness = spring.nominal_position(), spring.stiffness()
            else:
                continue
            if spring.joint().index() == joint.index():
                rest = float(rest) - start_position(joint)
                SubElement(dynamics, "spring_reference").text = repr(rest)
                SubElement(dynamics, "spring_stiffness").text = repr(float(stiffness))

    def _add_frame(self, model: Element, frame: Frame, name: str) -> None:
        attached = self._body_name(frame.body())
        element = SubElement(model, "frame", {"name": name, "attached_to": attached})
        _add_pose(element, frame.CalcPoseInBodyFrame(self._context))


def _spatial_inertia(shape: Shape) -> SpatialInertia:
    """Of a shape at a plausible density; of its hull if it encloses no volume."""
    density = DENSITY
    if isinstance(shape, Mesh) and not encloses_volume(Path(shape.source().path())):
        shape, density = Convex(shape.source().path()), _HULL_DENSITY
    try:
        return CalcSpatialInertia(shape, density)
    except (RuntimeError, ValueError):  # A flat sheet.
        return SpatialInertia.Zero()


def _add_pose(parent: Element, X: RigidTransform) -> None:
    rpy = RollPitchYaw(X.rotation()).vector()
    SubElement(parent, "pose").text = _text([*X.translation(), *rpy])


def _add_inertia(link: Element, mass: float, p_BBcm: Array, central: Array) -> None:
    """Adds the inertia matrix (3, 3) about the centre of mass, in the link's axes, [kg m^2]."""
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "pose").text = _text([*p_BBcm, 0.0, 0.0, 0.0])
    SubElement(inertial, "mass").text = repr(float(mass))
    inertia = SubElement(inertial, "inertia")
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        SubElement(inertia, f"i{'xyz'[i]}{'xyz'[j]}").text = repr(float(central[i, j]))


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
