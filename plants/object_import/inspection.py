"""What is in a model: links, joints, frames, and bars that a hand could hold."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex, Joint, RigidBody
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE, GraspRange
from crossmodal.plants.object_import.bars import Bar, bar_at, faults_of_bar
from crossmodal.plants.object_import.flat_model import (
    FlatNames,
    flat_names,
    has_travel,
    joints_above,
    links,
    moves,
    parent_joints,
    written_joints,
)
from crossmodal.plants.object_import.handles import SHORTEST, Going, bars_of, edges_of
from crossmodal.plants.object_import.model_source import Repair, read_model
from crossmodal.plants.object_import.object_import import finalize, parse
from crossmodal.plants.object_import.solids import solid_of

_MOST_FACES = 50_000  # Larger meshes are not searched for handles.
_NEXT_TO = 0.01  # A joint's axis: what turns in place there, [m].
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
    """A place that the hand can grasp.

    Attributes:
        grasp_frame: A frame of the model, or `LINK@x,y,z,roll,pitch,yaw`.
        joint: The nearest that moves it.
        joints: All that move it.
        bar: What is there.
        length: Of the bar, [m]; NaN where only a frame of the model says that it is one.
        faults: What about the bar is outside of what the hand can hold, in a few words each.
    """

    grasp_frame: str
    joint: str
    joints: list[str]
    bar: Bar
    length: float
    faults: list[str]


@dataclass(kw_only=True)
class Inspection:
    """All of it; `size` (3,) is that of the whole model in its own axes, [m]."""

    links: list[Link]
    joints: list[JointFacts]
    frames: dict[str, str]
    handles: list[Handle]
    size: Array
    warnings: list[str] = field(default_factory=list)


def inspect_model(
    source: Path, *, scale: float = 1.0, can: GraspRange = SOFT_HAND_RANGE
) -> Inspection:
    """Looks into an SDF or URDF, all joints at 0.

    Args:
        scale: Of all lengths in it.
        can: What the hand holds.

    Raises:
        ValueError: in one line, for what cannot be read.
    """
    warnings: list[str] = []
    model = read_model(source)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        Repair(source, folder / "meshes", warnings.append, scale).run(model)
        warnings = list(dict.fromkeys(warnings))
        plant, scene_graph = parse(model, source, folder)
        parents, names = parent_joints(plant, source), flat_names(plant)
        finalize(plant, source)
        inspector = scene_graph.model_inspector()
        return _Inspector(plant, inspector, parents, names, model.masses, can).run(warnings)


class _Inspector:
    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        parents: dict[int, Joint],
        names: FlatNames,
        masses: dict[str, float | None],
        can: GraspRange,
    ) -> None:
        self._masses = masses
        self._plant, self._inspector, self._can = plant, inspector, can
        self._parents, self._names = parents, names
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
            kind=joint.type_name() if joint.num_velocities() and has_travel(joint) else "fixed",
            parent=self._body_name(joint.parent_body()),
            child=self._body_name(joint.child_body()),
            lower=float(joint.position_lower_limits()[0]) if one else 0.0,
            upper=float(joint.position_upper_limits()[0]) if one else 0.0,
            moves=one,
        )

    def _moving_joint(self, body: RigidBody) -> Joint | None:
        """The nearest joint that moves a body."""
        return next((j for j in joints_above(body, self._parents) if moves(j)), None)

    def _way(self, body: RigidBody, joint: Joint, p_W: Array) -> Going:
        """How a joint lets a place of a body go; nowhere next to the joint's axis."""
        moving = self._plant.CreateDefaultContext()
        rates = np.zeros(self._plant.num_velocities())
        rates[joint.velocity_start()] = 1.0
        self._plant.SetVelocities(moving, rates)
        V_WB = self._plant.EvalBodySpatialVelocityInWorld(moving, body)
        way = V_WB.Shift(p_W - self._pose(body).translation()).translational()
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        rate, turn = float(np.linalg.norm(way)), V_WB.rotational()
        rate = rate if rate > _NEXT_TO else 0.0
        return Going(
            way=way / (rate if upper >= -lower else -rate) if rate else np.zeros(3),
            rate=rate,
            travel=rate * max(-lower, upper) if rate else 0.0,
            axis=turn / np.linalg.norm(turn) if np.any(turn) else turn,
            both=bool(-lower == upper),
        )

    def _handles(self, whole: trimesh.Trimesh) -> list[Handle]:
        """Frames of the model at which the hand can hold a bar, then such bars without one.

        Bars that it may not hold come last, and knobs of joints that have no bar.
        """
        found, places = list[Handle](), list[Array]()
        others = list[tuple[Array, Handle]]()
        frames = self._frames | {
            self._body_name(body): body.body_frame()
            for body in self._bodies
            if not self._plant.GetCollisionGeometriesForBody(body)
        }
        for name, frame in frames.items():
            handle = self._handle(
                frame.body(), frame.CalcPoseInBodyFrame(self._context), name, np.nan
            )
            if handle is not None and not handle.faults:
                places.append(frame.CalcPoseInWorld(self._context).translation())
                found.append(handle)
        for body in self._bodies:
            solid = self._solid([body])
            joint = self._moving_joint(body)
            if joint is None or not 0 < len(solid.faces) <= _MOST_FACES:
                continue
            X_WB = self._pose(body)
            axes, way = X_WB.rotation().matrix(), partial(self._way, body, joint)
            for X, length in bars_of(solid, whole, axes, way):
                X_WH = RigidTransform(X)
                X_BH = X_WB.inverse() @ X_WH
                handle = self._handle(body, X_BH, "", length)
                if handle is not None:
                    handle.faults += self._faults_of_way(way(X[:3, 3]), length)
                if handle is None or _near(X_WH.translation(), places, length):
                    continue
                if handle.faults:
                    others.append((X_WH.translation(), handle))
                else:
                    places.append(X_WH.translation())
                    found.append(handle)
        found += self._edges(whole, found)
        for p_WH, handle in sorted(others, key=lambda each: -each[1].length):
            is_alone = handle.joint not in {other.joint for other in found}
            if not _near(p_WH, places, handle.length) and (handle.length >= SHORTEST or is_alone):
                places.append(p_WH)
                found.append(handle)
        return found

    def _faults_of_way(self, way: Going, length: float) -> list[str]:
        if not way.rate:
            return ["it turns in place"] if length < SHORTEST else []
        if way.travel > self._can.gives:
            return []
        far = f"{1e3 * way.travel:.0f} mm, the hand itself gives {1e3 * self._can.gives:.0f} mm"
        return [f"it goes {far}"]

    def _edges(self, whole: trimesh.Trimesh, handles: list[Handle]) -> list[Handle]:
        """Free edges of boards that the hand can hold, one for each joint that moves no handle."""
        joints, found = {name for handle in handles for name in handle.joints}, dict[str, Handle]()
        for body in self._bodies:
            joint, solid = self._moving_joint(body), self._solid([body])
            if joint is None or not 0 < len(solid.faces) <= _MOST_FACES:
                continue
            name, X_WB = self._names.joints[int(joint.index())], self._pose(body)
            if name in joints | set(found):
                continue
            way = partial(self._way, body, joint)
            thickness = self._can.least_thickness, self._can.most_thickness
            for X, length in edges_of(solid, whole, X_WB.rotation().matrix(), way, *thickness):
                handle = self._handle(
                    body, X_WB.inverse() @ RigidTransform(X), "", length, edge=True
                )
                if handle is None or handle.faults or self._faults_of_way(way(X[:3, 3]), length):
                    continue
                found[name] = handle
                break
        return list(found.values())

    def _handle(
        self, body: RigidBody, X_BH: RigidTransform, name: str, length: float, *, edge: bool = False
    ) -> Handle | None:
        """What a hand would hold at a pose in a moving body, which a frame gives a name.

        Fingers are on both sides of an edge, where other bodies may be.
        """
        joint = self._moving_joint(body)
        bodies = self._bodies if edge else self._plant.GetBodiesWeldedTo(body)
        solid = self._solid(bodies, body.body_frame())
        if joint is None or solid.is_empty:
            return None
        solid.apply_transform(X_BH.inverse().GetAsMatrix4())
        bar = bar_at(solid, self._can.reach)
        if bar is not None and not (name or edge):
            # Only the tips of the fingers go into what is narrow.
            out = float(np.clip(self._can.tips - bar.behind, 0.0, self._can.reach))
            X_BH = X_BH @ RigidTransform([out, 0.0, 0.0])
            bar = bar_at(solid.apply_translation([-out, 0.0, 0.0]), self._can.reach)
        if bar is None or not (name or edge or max(bar.thickness) <= self._can.most_thickness):
            return None
        faults = faults_of_bar(bar, self._can)
        if length < SHORTEST and not faults and min(bar.thickness) < self._can.least_knob:
            faults.append(
                f"it is {1e3 * length:.0f} mm long and {1e3 * min(bar.thickness):.0f} mm thick, a"
                f" knob needs {1e3 * self._can.least_knob:.0f} mm"
            )
        return Handle(
            grasp_frame=name or f"{self._body_name(body)}@{_listed(X_BH)}",
            joint=self._names.joints[int(joint.index())],
            joints=[
                self._names.joints[int(each.index())]
                for each in joints_above(body, self._parents)
                if moves(each)
            ],
            bar=bar,
            length=length,
            faults=faults,
        )

    def _pose(self, body: RigidBody) -> RigidTransform:
        return self._plant.EvalBodyPoseInWorld(self._context, body)


def _near(place: Array, places: Sequence[Array], length: float) -> bool:
    """Whether one of some places is within half a bar's length."""
    return any(np.linalg.norm(place - other) < 0.5 * length for other in places)


def _listed(X: RigidTransform) -> str:
    values = [*X.translation(), *RollPitchYaw(X.rotation()).vector()]
    return ",".join(f"{round(value, 3) + 0.0:g}" for value in values)
