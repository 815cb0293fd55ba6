"""What is true about the joint that an episode explores, as a station gives it and over time."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, ScrewJoint
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.diagrams.run.record import Quantity, Tick
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.plants.screw_axis import screw_axis
from crossmodal.systems.port_values import JointType


@dataclass(frozen=True, kw_only=True)
class JointTruth(Immutable):
    """The constants of the explored joint.

    Attributes:
        name: In the object's model.
        type: Prismatic, revolute or screw; empty where nothing is known.
        axis_W: Unit axis (3,), the direction of growing q.
        point_W: A point (3,) on the axis, [m].
        parent_moves: Whether the joint's parent can move too; axis and point are those before
            anything moved.
        pitch: Of a screw, [m/rad]; else NaN.
    """

    name: str
    type: str
    axis_W: Array
    point_W: Array
    parent_moves: bool = False
    pitch: float = np.nan


UNKNOWN_JOINT = JointTruth(
    name="", type="", axis_W=np.full(3, np.nan), point_W=np.full(3, np.nan), parent_moves=False
)


@dataclass(frozen=True, kw_only=True)
class JointMechanicsTruth(Immutable):
    """What the explored joint takes to move, and its range.

    Attributes:
        friction: Coulomb friction, [N or N m]; NaN where nothing is known.
        damping: Viscous coefficient, [the same per (m or rad)/s].
        lower: End stop, [m or rad], in the joint's own position.
        upper: The other.
        detent: What holds it at the start beyond its Coulomb friction, [N or N m].
    """

    friction: float
    damping: float
    lower: float
    upper: float
    detent: float = 0.0


_NAN = float("nan")
UNKNOWN_MECHANICS = JointMechanicsTruth(friction=_NAN, damping=_NAN, lower=_NAN, upper=_NAN)
MECHANICS_QUANTITY = Quantity(port="cheat_joint_mechanics", model=UNKNOWN_MECHANICS)

_MOST_BEFORE = 32  # Ticks before the first grasp that are kept for drawing.
# What an application's station gives of the truth, and when the hand was closed.
TRUTH_QUANTITIES = (
    Quantity(port="cheat_joint", model=UNKNOWN_JOINT),
    Quantity(port="cheat_configuration", model=np.zeros(1)),
    Quantity(port="cheat_body_pose", model=RigidTransform()),
    Quantity(port="interaction_active", model=np.zeros(1)),
)


def joint_constants(plant: MultibodyPlant, joint: Joint) -> JointTruth:
    """The constants of a joint of a plant at its default state.

    Raises:
        ValueError: if it is neither prismatic, revolute nor a screw.
    """
    context, pitch = plant.CreateDefaultContext(), np.nan
    X_WJ = joint.frame_on_parent().CalcPoseInWorld(context)
    if isinstance(joint, PrismaticJoint):
        kind, axis_J = JointType.PRISMATIC, joint.translation_axis()
    elif isinstance(joint, RevoluteJoint):
        kind, axis_J = JointType.REVOLUTE, joint.revolute_axis()
    elif isinstance(joint, ScrewJoint):
        kind, axis_J = JointType.SCREW, screw_axis(plant, joint)
        pitch = joint.screw_pitch() / (2.0 * np.pi)  # Drake's is the translation per turn.
    else:
        raise ValueError(f"joint '{joint.name()}' is neither prismatic, revolute nor a screw")
    return JointTruth(
        name=joint.name(),
        type=str(kind),
        axis_W=np.asarray(X_WJ.rotation() @ axis_J, dtype=float),
        point_W=np.asarray(X_WJ.translation(), dtype=float),
        parent_moves=not plant.IsAnchored(joint.parent_body()),
        pitch=pitch,
    )


def joint_mechanics(joint: Joint, friction: float, detent: float = 0.0) -> JointMechanicsTruth:
    """Of a joint with one degree of freedom; friction and detent are what Drake does not know."""
    return JointMechanicsTruth(
        friction=friction,
        damping=float(joint.default_damping_vector()[0]),
        lower=float(joint.position_lower_limits()[0]),
        upper=float(joint.position_upper_limits()[0]),
        detent=detent,
    )


class ObjectTruth(LeafSystem):
    """The explored joint's constants, its true position and the moved body's true pose.

    Input ports:
    - `plant_state`: (nq + nv,).

    Output ports:
    - `cheat_joint`: `JointTruth`.
    - `cheat_joint_mechanics`: `JointMechanicsTruth`.
    - `cheat_configuration`: (1,) [m or rad].
    - `cheat_body_pose`: `RigidTransform` X_WB of the joint's child.

    Args:
        plant: The finalized plant.
        joint: The explored one.
        friction: Its Coulomb friction, [N or N m].
        detent: What holds it at the start beyond that, [N or N m].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        joint: Joint,
        friction: float = float("nan"),
        detent: float = 0.0,
    ) -> None:
        super().__init__()
        self._plant, self._joint = plant, joint
        self._scratch = plant.CreateDefaultContext()
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        for name, constants in (
            ("cheat_joint", joint_constants(plant, joint)),
            ("cheat_joint_mechanics", joint_mechanics(joint, friction, detent)),
        ):
            self.DeclareAbstractOutputPort(
                name,
                lambda value=constants: Value[object](value),
                lambda context, output, value=constants: output.set_value(value),
                {self.nothing_ticket()},
            )
        self.DeclareVectorOutputPort("cheat_configuration", 1, self._calc_configuration)
        self.DeclareAbstractOutputPort(
            "cheat_body_pose", lambda: Value(RigidTransform()), self._calc_pose
        )

    def _calc_configuration(self, context: Context, output: BasicVector) -> None:
        state = np.asarray(self._state.Eval(context))
        output.SetAtIndex(0, state[self._joint.position_start()])

    def _calc_pose(self, context: Context, output: Value) -> None:
        self._plant.SetPositionsAndVelocities(self._scratch, self._state.Eval(context))
        output.set_value(self._plant.EvalBodyPoseInWorld(self._scratch, self._joint.child_body()))


@dataclass(frozen=True, kw_only=True)
class Truth(JointTruth):
    """What is true about the explored joint over an episode. Only the evaluation reads it.

    Attributes:
        times: Instants of the network's ticks (T,), [s].
        configuration: The joint's position q (T,), [m or rad].
        X_WB: Pose (T, 4, 4) of the moved body; NaN where it is not known.
        grasp_time: The instant the hand was closed, [s]; NaN where it never was, and the first tick
            where nobody says when it was.
        regrasp_times: When it was closed again after a lost grasp, [s].
        mechanics: What the joint takes to move, and its range in its own position.
    """

    times: Array
    configuration: Array
    X_WB: Array
    grasp_time: float
    regrasp_times: list[float] = field(default_factory=list)
    mechanics: JointMechanicsTruth = UNKNOWN_MECHANICS

    @property
    def joint_type(self) -> JointType | None:
        """Prismatic, revolute or screw; None where nothing is known."""
        return JointType(self.type) if self.type else None

    def last_grasp(self, time: float) -> float:
        """When the hand was last closed before `time`, [s]; else when it was closed first."""
        return max(
            (again for again in self.regrasp_times if again <= time), default=self.grasp_time
        )

    def opening(self) -> Array:
        """The joint's travel since the grasp (T,), [m or rad]; zero at the first tick after it."""
        if len(self.times) == 0:
            return self.configuration
        start = min(int(np.searchsorted(self.times, self.grasp_time)), len(self.times) - 1)
        return self.configuration - self.configuration[start]


def add_tick(station: list[Tick], tick: Tick) -> None:
    """Adds a tick to those from which `truth_of_ticks` says what is true at the newest one.

    Between two changes of the grasp only the newest tick stays, so that the list does not grow with
    the episode. Before the first grasp, to which beliefs about what is only seen refer, some do.
    """
    if any(map(_holds, station)):
        if _holds(station[-1]) == _holds(station[-2]):
            station.pop()
    elif len(station) >= _MOST_BEFORE:
        del station[1::2]
    station.append(tick)


def _holds(tick: Tick) -> bool:
    return bool(tick.values.get("interaction_active", np.zeros(1))[0] > 0.5)


def _is_known(tick: Tick) -> bool:
    """Whether the joint's position is; that of a recording may begin after its images."""
    return bool(np.isfinite(tick.values.get("cheat_configuration", np.full(1, np.nan))).all())


def _body_pose(tick: Tick) -> Array:
    """The true X_WB (4, 4) at a tick; NaN where only the joint's position is known."""
    pose: RigidTransform | None = tick.values.get("cheat_body_pose")
    return np.full((4, 4), np.nan) if pose is None else pose.GetAsMatrix4()


def truth_of_ticks(station: Sequence[Tick]) -> Truth:
    """The truth in what a station gave at its ticks; where it gave none, everything is unknown."""
    ticks = [tick for tick in station if _is_known(tick)]
    constants: JointTruth = next(
        (tick.values["cheat_joint"] for tick in ticks if "cheat_joint" in tick.values),
        UNKNOWN_JOINT,
    )
    port = MECHANICS_QUANTITY.port
    mechanics = next((t.values[port] for t in station if port in t.values), UNKNOWN_MECHANICS)
    holds = [False, *map(_holds, station)]
    grasps = [t.time for t, before in zip(station, holds, strict=False) if _holds(t) > before]
    # Of a recording that does not say when a hand held the object, travel counts from its start.
    is_told = any("interaction_active" in tick.values for tick in station)
    start = float("nan") if is_told or not ticks else ticks[0].time
    poses = [_body_pose(tick) for tick in ticks]
    return Truth(
        **vars(constants),
        times=np.array([tick.time for tick in ticks]),
        configuration=np.array([float(tick.values["cheat_configuration"][0]) for tick in ticks]),
        X_WB=np.array(poses).reshape(-1, 4, 4),
        grasp_time=grasps[0] if grasps else start,
        regrasp_times=grasps[1:],
        mechanics=mechanics,
    )
