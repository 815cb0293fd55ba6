"""The system that finds friction, end stops and detents of the joint in the hand."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.kinematics.joint_screws import HandForce
from crossmodal.systems.kinematics.mechanics.joint_mechanics_config import JointMechanicsConfig
from crossmodal.systems.kinematics.mechanics.joint_mechanics_filters import (
    JointMechanicsFilters,
    JointMechanicsState,
)
from crossmodal.systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    BodyMotions,
    EndEffectorBelief,
    GraspType,
    HandLoad,
    JointBelief,
    JointBeliefs,
    JointMechanicsBeliefs,
)
from crossmodal.systems.recursive_filter import RecursiveFilter

_DOWN_W = np.array([0.0, 0.0, -1.0])
SENSOR_LEVER = 0.1  # Error of a torque by that of a force, [m].
_WRENCH = np.repeat([SENSOR_LEVER, 1.0], 3)
# Least error of a sensor's zero, which drifts and depends on how the hand's weight is turned.
_LEAST_ZERO = 0.05 * _WRENCH  # [N m], [N]
_FREE = 60  # Readings of the open hand that are remembered.
_CORRELATED = 10.0  # Readings per independent sample.


@dataclass(frozen=True, kw_only=True)
class HeldJointMechanics(Immutable):
    """The system's state.

    Attributes:
        free: Readings (6,) of an open hand, the latest.
        zero: What the sensor reads (6,) of a hand that touches nothing.
        zero_variance: (6,)
        joints: By the joint's parent.
    """

    zero: Array
    zero_variance: Array
    free: tuple[Array, ...] = ()
    joints: dict[int, JointMechanicsState] = field(default_factory=dict)


def watch_free_hand(state: HeldJointMechanics, load: HandLoad) -> HeldJointMechanics:
    """The zero is the median of what an open hand reads: bias, and a wrong model of its weight.

    An arm that starts or stops, or touches early, disturbs few of these readings.
    """
    free = (*state.free, load.F_S)[-_FREE:]
    readings = np.array(free)
    zero = np.median(readings, axis=0)
    spread = MEDIAN_TO_SIGMA * np.median(np.abs(readings - zero), axis=0)
    known = len(free) / _CORRELATED
    if known < 1.0:
        return replace(state, free=free)
    variance = spread**2 / known + _LEAST_ZERO**2
    return replace(state, free=free, zero=zero, zero_variance=variance)


def hand_force(
    load: HandLoad, state: HeldJointMechanics, hand: EndEffectorBelief, X_WP: Array
) -> HandForce:
    """What the hand does to the body, in P.

    The sensor reads what the body does to the hand, and has E's origin and axes.
    """
    X_PE = se3.inverse(X_WP) @ hand.X
    to_P = se3.adjoint(se3.inverse(X_PE)).T
    return HandForce(
        F_P=to_P @ (state.zero - load.F_S),
        X_PE=X_PE,
        pose_jacobian=hand.bias_jacobian,
        zero_covariance=to_P @ np.diag(state.zero_variance + load.variances) @ to_P.T,
        down_P=X_WP[:3, :3].T @ _DOWN_W,
    )


class JointMechanicsFilter(RecursiveFilter):
    """Friction, range and detents of the joint in the hand, from the wrist's force.

    Input ports:
    - `joints_estimated`: `JointBeliefs` of this tick, in P.
    - `hand_load_estimated`: `HandLoad` of this tick: what the wrist measures, without the hand's
      weight. An open hand's is the sensor's zero.
    - `end_effector_estimated`: `EndEffectorBelief` X_WE.
    - `interaction_active`: (1,) above 0.5 from the instant at which the hand has closed.
    - `grasp_latest`: `GraspBelief`; while the grasp has likely failed, no force counts. May stay
      unconnected.
    - `body_motions_latest`: `BodyMotions` of the joints' parents, where they move. May stay
      unconnected.

    Output ports:
    - `joint_mechanics_estimated`: `JointMechanicsBeliefs` of this tick.
    - `joint_mechanics_latest`: of the last tick, from the state alone.

    Frames: W world, P the joint's parent, E end-effector, S wrist sensor, which has E's axes.

    Source: our own, see `JointMechanicsFilters`.
    """

    def __init__(self, config: JointMechanicsConfig) -> None:
        super().__init__()
        self._filters = JointMechanicsFilters(config, owner="JointMechanicsFilter")
        self._joints = self._declare_value_input("joints_estimated", JointBeliefs())
        self._load = self._declare_value_input("hand_load_estimated", UNKNOWN_LOAD)
        self._hand = self._declare_value_input("end_effector_estimated", UNKNOWN_END_EFFECTOR)
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._grasp = self.DeclareAbstractInputPort("grasp_latest", Value[object]())
        self._bodies = self._declare_value_input("body_motions_latest", BodyMotions())
        variance = (config.zero_force * _WRENCH) ** 2
        initial = HeldJointMechanics(zero=np.zeros(6), zero_variance=variance)
        self._declare_recursion(initial, self._calc_state, config.period)
        self._declare_estimated("joint_mechanics_estimated", self._beliefs)
        self._declare_latest("joint_mechanics_latest", self._beliefs)

    def _calc_state(self, context: Context, state: HeldJointMechanics) -> HeldJointMechanics:
        load: HandLoad = self._read(self._load, context)
        measured = bool(np.isfinite(load.F_S).all())
        if self._read(self._active, context)[0] <= 0.5:
            opened = bool(np.all(load.pressures < self._filters.config.open_pressure))
            state = replace(state, joints={})
            return watch_free_hand(state, load) if measured and opened else state
        grasp = self._read_optional(self._grasp, context)
        failed = 0.0 if grasp is None else grasp.probabilities[GraspType.FAILED]
        held = measured and failed <= 0.5
        joints = {}
        for joint in self._read(self._joints, context).joints:
            if joint.child_id == HELD_BODY:
                X_WP = self._parent(context, joint)
                force = None
                if held and X_WP is not None:
                    force = hand_force(load, state, self._read(self._hand, context), X_WP)
                known = state.joints.get(joint.parent_id, self._filters.start())
                joints[joint.parent_id] = self._filters.update(known, joint, force)
        return replace(state, joints=joints)

    def _parent(self, context: Context, joint: JointBelief) -> Array | None:
        if joint.parent_id == STATIC_BODY:
            return np.eye(4)
        bodies = self._read_optional(self._bodies, context)
        parent = None if bodies is None else bodies.find(joint.parent_id)
        return None if parent is None else np.asarray(parent.motion.X)

    def _beliefs(self, state: HeldJointMechanics) -> JointMechanicsBeliefs:
        return JointMechanicsBeliefs(
            joints=[self._filters.belief(joint) for joint in state.joints.values()]
        )
