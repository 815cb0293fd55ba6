"""An articulated object as it is perceived: a tree of bodies and joints, without any truth.

Frames: R the object's root, P a joint's parent, B its child. The fields are plain, so that YAML
holds them.
"""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, unknown
from crossmodal.systems.port_values import JointModelBelief, JointType

_NAN = float("nan")


@dataclass(kw_only=True)
class ObjectBody:
    """A rigid body.

    Attributes:
        name: Of its link.
        frame: Name of the frame B that its poses are of.
        X_WB: Where B is (4, 4), [m].
        low: Least coordinates (3,) in B of what was perceived of its shape, [m]; NaN where
            nothing was.
        high: The largest.
    """

    name: str = ""
    frame: str = ""
    X_WB: np.ndarray = unknown(4, 4)
    low: np.ndarray = unknown(3)
    high: np.ndarray = unknown(3)


@dataclass(kw_only=True)
class ObjectJoint:
    """A joint: X_PB(q) = exp(S_P q) X_PB_zero. NaN stands for what is not known.

    Attributes:
        name: Of the joint.
        parent: Name of the parent's body, or the object's root.
        child: Name of the child's body.
        type: A `JointType` that is not disconnected.
        probability: Of the type; NaN where no other was considered.
        hinge_probability: That it is a hinge, or a screw that climbs next to nothing.
        updates: Measurements that it is estimated from; 0 where they were not counted.
        S_P: Unit screw (6,), rotation first; NaN of a rigid joint.
        X_PB_zero: (4, 4)
        q: Configuration, [m] of a prismatic joint, else [rad].
        q_deviation: Its standard deviation.
        lower: Least configuration that is known to be possible.
        upper: The largest.
        lower_deviation: Standard deviation of that.
        upper_deviation: Likewise.
        lower_is_stop: Whether the joint has reached an end stop there; else it was not seen to go
            farther.
        upper_is_stop: Likewise.
        axis_deviation: Standard deviation of the axis' direction, both directions together, [rad].
        position_deviation: Of its position, all directions together, [m].
        pitch: Of a screw, [m/rad].
        pitch_deviation: Its standard deviation.
        friction: Coulomb friction, [N or N m].
        friction_deviation: Its standard deviation.
        damping: Viscous coefficient, [the same per (m or rad)/s].
        damping_deviation: Its standard deviation.
    """

    name: str = ""
    parent: str = ""
    child: str = ""
    type: str = str(JointType.RIGID)
    probability: float = _NAN
    hinge_probability: float = _NAN
    updates: int = 0
    S_P: np.ndarray = unknown(6)
    X_PB_zero: np.ndarray = unknown(4, 4)
    q: float = _NAN
    q_deviation: float = _NAN
    lower: float = _NAN
    upper: float = _NAN
    lower_deviation: float = _NAN
    upper_deviation: float = _NAN
    lower_is_stop: bool = False
    upper_is_stop: bool = False
    axis_deviation: float = _NAN
    position_deviation: float = _NAN
    pitch: float = _NAN
    pitch_deviation: float = _NAN
    friction: float = _NAN
    friction_deviation: float = _NAN
    damping: float = _NAN
    damping_deviation: float = _NAN

    @property
    def moves(self) -> bool:
        """Whether the type has a path."""
        return self.type != JointType.RIGID

    @property
    def turns(self) -> bool:
        """Whether it turns about an axis that has a place."""
        return self.type in (JointType.REVOLUTE, JointType.SCREW)

    @property
    def axis_P(self) -> Array:
        """Direction (3,) of the axis; NaN without one."""
        return self.S_P[:3] if self.turns else self.S_P[3:]

    @property
    def p_PA(self) -> Array:
        """The point (3,) of a turning joint's axis nearest to the child at q = 0, [m]."""
        axis, moment = self.S_P[:3], self.S_P[3:]
        return np.asarray(np.cross(axis, moment) + axis * (axis @ self.X_PB_zero[:3, 3]))

    @property
    def X_PJ(self) -> Array:
        """Frame (4, 4) of the joint: P's axes, on the axis next to the child, or at the child."""
        X = np.eye(4)
        X[:3, 3] = self.p_PA if self.turns else self.X_PB_zero[:3, 3]
        return X

    def pose(self, q: float) -> Array:
        """X_PB (4, 4) on the joint's path."""
        if not self.moves:
            return self.X_PB_zero
        return np.asarray(se3.exp(self.S_P * q) @ self.X_PB_zero)


@dataclass(kw_only=True)
class ArticulatedObject:
    """All that is joined to one root.

    Attributes:
        root: Name of the body that the others are joined to.
        X_WR: Where it is (4, 4), [m].
        time: Since when nothing new is known, [s].
        bodies: Without the root, parents before their children.
        joints: One for each body, in the same order.
    """

    root: str = ""
    X_WR: np.ndarray = field(default_factory=lambda: np.eye(4))
    time: float = _NAN
    bodies: list[ObjectBody] = field(default_factory=list)
    joints: list[ObjectJoint] = field(default_factory=list)


def screw_of(joint_type: JointType, model: JointModelBelief) -> Array:
    """The unit screw (6,), rotation first, of a joint that moves, in its parent's frame."""
    if joint_type == JointType.PRISMATIC:
        return np.concatenate([np.zeros(3), model.axis_P])
    climb = model.pitch if joint_type == JointType.SCREW else 0.0
    moment = np.cross(model.p_PA, model.axis_P) + climb * model.axis_P
    return np.concatenate([model.axis_P, moment])


def uncertainty(joint: ObjectJoint) -> list[str]:
    """What a model cannot say of a joint, a line each."""
    certain = "" if np.isnan(joint.probability) else f", probability {joint.probability:.3f}"
    count = f", from {joint.updates} poses" if joint.updates else ""
    lines = [f"{joint.name}: {joint.type}{certain}{count}"]
    if joint.type == JointType.REVOLUTE and np.isfinite(joint.hinge_probability):
        lines.append(f"a hinge with probability {joint.hinge_probability:.3f}")
    if joint.moves:
        lines.append(f"axis known to {np.rad2deg(joint.axis_deviation):.3g} deg")
        lines += _limits_told(joint)
    if joint.turns:
        lines.append(f"position of the axis known to {1e3 * joint.position_deviation:.3g} mm")
    if joint.type == JointType.SCREW:
        lines.append(f"pitch {joint.pitch:.4g} +- {joint.pitch_deviation:.2g} m/rad")
    unit = "N m" if joint.turns else "N"
    if np.isfinite(joint.friction):
        lines.append(f"friction {joint.friction:.3g} +- {joint.friction_deviation:.2g} {unit}")
    if np.isfinite(joint.damping):
        rate = f"{unit} s/{_unit(joint)}"
        lines.append(f"damping {joint.damping:.3g} +- {joint.damping_deviation:.2g} {rate}")
    return lines


def _unit(joint: ObjectJoint) -> str:
    return "rad" if joint.turns else "m"


def _limits_told(joint: ObjectJoint) -> list[str]:
    unit = _unit(joint)
    if not (joint.lower_is_stop or joint.upper_is_stop):
        lower = _with_deviation(joint.lower, joint.lower_deviation)
        upper = _with_deviation(joint.upper, joint.upper_deviation)
        return [f"limits are what was seen, {lower} to {upper} {unit}"]
    lines = []
    for name, value, deviation, reached in (
        ("lower", joint.lower, joint.lower_deviation, joint.lower_is_stop),
        ("upper", joint.upper, joint.upper_deviation, joint.upper_is_stop),
    ):
        how = "an end stop" if reached else "what was seen"
        lines.append(f"{name} limit {_with_deviation(value, deviation)} {unit} is {how}")
    return lines


def _with_deviation(value: float, deviation: float) -> str:
    known = f" +- {deviation:.2g}" if np.isfinite(deviation) else ""
    return f"{value:.4g}{known}"
