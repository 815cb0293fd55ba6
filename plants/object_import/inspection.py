"""What is in a model: links, joints, frames, and bars that a hand could hold."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex, Joint, RigidBody
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.bars import Bar, bar_at
from crossmodal.plants.object_import.flat_model import (
    flat_names,
    joints_above,
    links,
    moves,
    parent_joints,
    written_joints,
)
from crossmodal.plants.object_import.model_source import Repair, read_model
from crossmodal.plants.object_import.object_import import parse
from crossmodal.plants.object_import.solids import solid_of

_MOST_FACES = 50_000  # Larger meshes are not searched for handles.
_SHORTEST, _LONGEST, _SLENDER = 0.08, 1.0, 2.0  # Of a handle, [m]; its length over its thickness.
_HAND = 0.05  # Half width of what must be free before a handle, [m].
_AHEAD = 0.2  # How far before it, [m].
_DIRECTIONS = 16
_OF_JOINTS = ("_parent_F", "_child_M")  # Frames that the parser makes.


@dataclass(kw_only=True)
class Link:
    """A link: its name, the size (3,) of its bounds in its own axes [m], and its mass [kg].

    The mass is NaN where the file gives none.
    """

    name: str
    size: Array
    mass: float


@dataclass(kw_only=True)
class JointFacts:
    """A joint: its type, the links that it joins and, for one that moves, its limits [m or rad]."""

    name: str
    kind: str
    parent: str
    child: str
    lower: float
    upper: float
    moves: bool


@dataclass(kw_only=True)
class Handle:
    """A place to grasp.

    Attributes:
        grasp_frame: A frame of the model, or `LINK@x,y,z,roll,pitch,yaw`.
        joint: The nearest that moves it.
        bar: What is there.
        length: Of the bar, [m]; NaN where only a frame of the model says that it is one.
    """

    grasp_frame: str
    joint: str
    bar: Bar
    length: float


@dataclass(kw_only=True)
class Inspection:
    """All of it; `size` (3,) is that of the whole model in its own axes, [m]."""

    links: list[Link]
    joints: list[JointFacts]
    frames: dict[str, str]
    handles: list[Handle]
    size: Array
    warnings: list[str] = field(default_factory=list)


def inspect_model(source: Path, *, scale: float = 1.0, reach: float = 0.03) -> Inspection:
    """Looks into an SDF or URDF, all joints at 0.

    Args:
        scale: Of all lengths in it.
        reach: Greatest distance from a frame to a bar that it may stand for, [m].

    Raises:
        ValueError: in one line, for what cannot be read.
    """
    warnings: list[str] = []
    model = read_model(source)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        Repair(source, folder / "meshes", warnings.append, scale).run(model)
        plant, scene_graph = parse(model, source, folder, as_it_is=False)
        parents = parent_joints(plant, source)
        plant.Finalize()
        return _Inspector(plant, scene_graph.model_inspector(), parents, model.masses, reach).run(
            warnings
        )


class _Inspector:
    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        parents: dict[int, Joint],
        masses: dict[str, float | None],
        reach: float,
    ) -> None:
        self._masses = masses
        self._plant, self._inspector, self._reach = plant, inspector, reach
        self._parents, self._names = parents, flat_names(plant)
        self._context: Context = plant.CreateDefaultContext()
        self._bodies = links(plant)
        self._frames = {
            name: plant.get_frame(FrameIndex(index))
            for index, name in self._names.frames.items()
            if not name.endswith(_OF_JOINTS)
        }

    def run(self, warnings: list[str]) -> Inspection:
        whole = self._solid(self._bodies)
        return Inspection(
            links=[self._link(body) for body in self._bodies],
            joints=[self._joint(joint) for joint in written_joints(self._plant)],
            frames={name: self._body_name(frame.body()) for name, frame in self._frames.items()},
            handles=self._handles(whole),
            size=np.zeros(3) if whole.is_empty else whole.extents,
            warnings=warnings,
        )

    def _body_name(self, body: RigidBody) -> str:
        return self._names.bodies.get(int(body.index()), "world")

    def _solid(self, bodies: Sequence[RigidBody], frame: object = None) -> trimesh.Trimesh:
        frame = self._plant.world_frame() if frame is None else frame
        return solid_of(self._plant, self._inspector, self._context, bodies, frame)

    def _link(self, body: RigidBody) -> Link:
        solid = self._solid([body], body.body_frame())
        size = np.zeros(3) if solid.is_empty else solid.extents
        mass = self._masses.get(body.name(), body.default_mass())
        return Link(
            name=self._body_name(body), size=size, mass=np.nan if mass is None else float(mass)
        )

    def _joint(self, joint: Joint) -> JointFacts:
        one = moves(joint)
        return JointFacts(
            name=self._names.joints[int(joint.index())],
            kind=joint.type_name() if joint.num_velocities() else "fixed",
            parent=self._body_name(joint.parent_body()),
            child=self._body_name(joint.child_body()),
            lower=float(joint.position_lower_limits()[0]) if one else 0.0,
            upper=float(joint.position_upper_limits()[0]) if one else 0.0,
            moves=one,
        )

    def _moving_joint(self, body: RigidBody) -> str:
        """The nearest joint that moves a body; empty for none."""
        above = joints_above(body, self._parents)
        return next((self._names.joints[int(j.index())] for j in above if moves(j)), "")

    def _handles(self, whole: trimesh.Trimesh) -> list[Handle]:
        """Frames of the model that are in a bar, then bars without one."""
        found, places = list[Handle](), list[Array]()
        frames = self._frames | {
            self._body_name(body): body.body_frame()
            for body in self._bodies
            if not self._plant.GetCollisionGeometriesForBody(body)
        }
        for name, frame in frames.items():
            joint = self._moving_joint(frame.body())
            solid = self._solid(self._plant.GetBodiesWeldedTo(frame.body()), frame)
            bar = bar_at(solid, self._reach) if joint and not solid.is_empty else None
            if bar is not None:
                places.append(frame.CalcPoseInWorld(self._context).translation())
                found.append(Handle(grasp_frame=name, joint=joint, bar=bar, length=np.nan))
        points = _samples(whole)
        for body in self._bodies:
            joint = self._moving_joint(body)
            for X_BH, length in self._bars(body, points) if joint else ():
                p_WH = self._pose(body) @ X_BH.translation()
                if any(np.linalg.norm(p_WH - place) < 0.5 * length for place in places):
                    continue
                solid = self._solid(self._plant.GetBodiesWeldedTo(body), body.body_frame())
                solid.apply_transform(X_BH.inverse().GetAsMatrix4())
                bar = bar_at(solid, self._reach)
                if bar is not None:
                    places.append(p_WH)
                    name = f"{self._body_name(body)}@{_listed(X_BH)}"
                    found.append(Handle(grasp_frame=name, joint=joint, bar=bar, length=length))
        return found

    def _pose(self, body: RigidBody) -> RigidTransform:
        return self._plant.EvalBodyPoseInWorld(self._context, body)

    def _bars(self, body: RigidBody, points: Array) -> list[tuple[RigidTransform, float]]:
        """Pose in the body and length of each of its parts that is long and thin, and free."""
        solid, bars = self._solid([body], body.body_frame()), []
        if solid.is_empty or len(solid.faces) > _MOST_FACES:
            return []
        X_BW = self._pose(body).inverse()
        around = X_BW.rotation().matrix() @ points.T + X_BW.translation()[:, None]
        for part in solid.split(only_watertight=False):
            X_BP, extents = _oriented(part)
            length, width = extents[1], max(extents[0], extents[2])
            if not _SHORTEST <= length <= _LONGEST or length < _SLENDER * width:
                continue
            R_BH = _free_direction(X_BP, around.T, 0.5 * width)
            if R_BH is not None:
                bars.append((RigidTransform(R_BH, X_BP.translation()), float(length)))
        return bars


def _oriented(part: trimesh.Trimesh) -> tuple[RigidTransform, Array]:
    """Pose of a part's middle, its longest extent along y, and the extents (3,) there."""
    spread = part.vertices - part.vertices.mean(axis=0)
    _, _, axes = np.linalg.svd(spread, full_matrices=False)
    R = np.column_stack([axes[1], axes[0], np.cross(axes[1], axes[0])])
    inside = part.vertices @ R
    middle = 0.5 * (inside.min(axis=0) + inside.max(axis=0))
    rotation = RotationMatrix.ProjectToRotationMatrix(R)
    return RigidTransform(rotation, R @ middle), np.ptp(inside, axis=0)


def _free_direction(X_BP: RigidTransform, points: Array, radius: float) -> RotationMatrix | None:
    """Axes of a bar along y whose x is where a hand can come from, away from the object."""
    middle = points.mean(axis=0)
    best, most = None, -np.inf
    for angle in np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS:
        R = X_BP.rotation() @ RotationMatrix.MakeYRotation(angle)
        seen = (points - X_BP.translation()) @ R.matrix()
        ahead = (seen[:, 0] > radius + 0.005) & (seen[:, 0] < _AHEAD)
        near = (np.abs(seen[:, 1]) < _HAND) & (np.abs(seen[:, 2]) < _HAND)
        outward = float((X_BP.translation() - middle) @ R.matrix()[:, 0])
        # Behind a bar is what it is fixed to.
        behind = float(np.median(seen[:, 0]))
        if not np.any(ahead & near) and outward - behind > most:
            best, most = R, outward - behind
    return best


def _samples(whole: trimesh.Trimesh) -> Array:
    """Points (n, 3) all over a solid."""
    if whole.is_empty:
        return np.zeros((1, 3))
    points, _ = trimesh.sample.sample_surface(whole, 20_000, seed=0)
    return np.asarray(points)


def _listed(X: RigidTransform) -> str:
    values = [*X.translation(), *RollPitchYaw(X.rotation()).vector()]
    return ",".join(f"{round(value, 3) + 0.0:g}" for value in values)
