"""Operational-space impedance control on SE(3)."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel, ArmState
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class ImpedanceGains(Immutable):
    """Virtual spring, damper and mass, each (6, 6) in E, rotation first (SI)."""

    stiffness: Array
    damping: Array
    mass: Array

    @property
    def exists(self) -> bool:
        """False for `NO_GAINS`."""
        return not np.isnan(self.stiffness[0, 0])


@dataclass(kw_only=True)
class DesiredMotion(Immutable):
    """Where the end-effector should be.

    Attributes:
        X_WE: Pose (4, 4).
        V_WE_E: Velocity (6,), [rad/s, m/s].
        A_WE_E: Acceleration (6,), [rad/s^2, m/s^2].
    """

    X_WE: Array
    V_WE_E: Array
    A_WE_E: Array

    @property
    def exists(self) -> bool:
        """False for `NO_MOTION`."""
        return not np.isnan(self.X_WE[0, 0])


_STEP = 1e-4  # For the slope of the weight, [rad].
_NAN = np.full((6, 6), np.nan)
# Output of a source that does not command the arm; Drake's newer versions refuse None as a value.
NO_MOTION = DesiredMotion(X_WE=_NAN[:4, :4], V_WE_E=_NAN[0], A_WE_E=_NAN[0])
NO_GAINS = ImpedanceGains(stiffness=_NAN, damping=_NAN, mass=_NAN)


@dataclass(kw_only=True)
class ImpedanceConfig:
    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Of the null space. Encoders that are off tell wrongly in which directions the arm moves
    # without its hand, so that the hand feels a part of this spring, and tilts on the bar that it
    # holds. At 1 N m/rad the `torque_error` of the arm's weight moves the elbow by 0.3 rad.
    posture_stiffness: float = number(1.0, at_least=0.0, at_most=1e4, unit="N m/rad")
    # Of the null space.
    posture_damping: float = number(0.4, at_least=0.0, at_most=1e4, unit="N m s/rad")
    torque_limit: float = number(60.0, above=0.0, at_most=1e4, unit="N m")  # Of every joint.
    # Time constant with which the offset takes over the springs' load.
    tare_time: float = number(0.3, at_least=1e-3, at_most=3600.0, unit="s")
    # By how much a joint's zero is off, 1 sigma. It and `torque_error` are what the offset may come
    # from.
    zero_error: float = number(float(np.deg2rad(5.0)), above=0.0, at_most=3.2, unit="rad")
    # How large other torques on a joint are, such as a load of another weight, 1 sigma.
    torque_error: float = number(0.3, above=0.0, at_most=1e4, unit="N m")


def impedance_wrench(state: ArmState, desired: DesiredMotion, gains: ImpedanceGains) -> Array:
    """F_E = K log(X_WE^-1 X_WE_des) + D (V_des - V) + M A_des, (6,) in E.

    The arm's own inertia is not reshaped: M multiplies the desired acceleration only. Cancelling
    the true inertia needs the contact force within a millisecond or so, and the wrist sensor gives
    it at 100 Hz.
    """
    error = se3.log(se3.inverse(state.X_WE) @ desired.X_WE)
    return (
        gains.stiffness @ error
        + gains.damping @ (desired.V_WE_E - state.V_WE_E)
        + gains.mass @ desired.A_WE_E
    )


def bounded_damping(damping: Array, state: ArmState, rate: float) -> Array:
    """Damping (6, 6) in E under which no motion of E decays faster than by `rate` [1/s].

    V' = -J M^-1 J^T D V, whose rates are the eigenvalues of C^T D C with C C^T = J M^-1 J^T. A
    digital damper acts a period late: what it would stop faster than that, it shakes.

    Args:
        damping: As wanted, symmetric.
    """
    C = np.linalg.solve(np.linalg.cholesky(state.M), state.J_E.T).T
    rates, directions = np.linalg.eigh(C.T @ damping @ C)
    is_fast = rates > rate
    fast, W = rates[is_fast], damping @ C @ directions[:, is_fast]
    return damping - (W * (fast - rate) / fast**2) @ W.T


def posture_torque(state: ArmState, q_posture: Array, stiffness: float, damping: float) -> Array:
    """Spring and damper towards `q_posture` (n,), projected so that E feels no wrench."""
    tau = stiffness * (q_posture - state.q) - damping * state.v
    wrench, *_ = np.linalg.lstsq(state.J_E.T, tau, rcond=1e-3)
    return tau - state.J_E.T @ wrench


def weight_error(arm: ArmModel, q: Array, zeros: Array) -> Array:
    """What the arm's weight takes beyond what is computed from encoders that are off.

    Args:
        q: As the encoders read it (n,), [rad].
        zeros: By how much they read too much (n,), [rad].

    Returns:
        Torques (n,), [N m].
    """
    if not zeros.any():
        return np.zeros(len(q))
    return arm.CalcHoldingTorque(q - zeros) - arm.CalcHoldingTorque(q)


def likely_zeros(arm: ArmModel, q: Array, torque: Array, config: ImpedanceConfig) -> Array:
    """By how much the encoders read too much (n,) [rad], if the arm at rest takes `torque` more.

    The maximum of the posterior with the configured standard deviations, by first order.

    Args:
        q: As the encoders read it (n,), [rad].
        torque: What holds the arm, beyond what is computed (n,), [N m].
    """
    steps = _STEP * np.eye(len(q))
    slopes = [arm.CalcHoldingTorque(q - step) - arm.CalcHoldingTorque(q + step) for step in steps]
    G = np.column_stack(slopes) / (2.0 * _STEP)
    ratio = config.torque_error / config.zero_error
    return np.asarray(G.T @ np.linalg.solve(G @ G.T + ratio**2 * np.eye(len(q)), torque))


class ImpedanceController(LeafSystem):
    """Makes the end-effector a mass-spring-damper around the desired motion.

    tau = J^T (K log(X^-1 X_des) + D (V_des - V) + M A_des) + bias + null-space posture + offset.

    Encoders that are off make the arm's weight wrong, by more than the compliant spring and a hand
    that holds a bar can bear. So while nothing touches the hand, the offset integrates the torques
    of spring, J^T K log(X^-1 X_des), and posture. Elsewhere the weight is wrong by another torque,
    under which a hand tilts that goes half a metre with a door. So the offset is explained by zeros
    of the joints that are off, as far as it can be, and goes on with the weight that they make;
    what is left of it is kept.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s] from the encoders.
    - `motion_desired`: `DesiredMotion`.
    - `gains_desired`: `ImpedanceGains`.
    - `tare`: (1,) above 0.5 while nothing touches the hand; the offset stays zero if not connected.

    Output ports:
    - `torque_commanded`: (n,) [N m], held over the period.

    State: the torque commanded (n,) [N m]; what is left of the offset (n,) [N m], and by how much
    the joints' zeros are off (n,) [rad].

    Frames: W world, E end-effector. Source: crossmodal paper, section VI; stiffness on SE(3) by
    the logarithm of the pose error in E.

    Args:
        config: Of posture, limit and offset.
        arm: The robot's own model.
        q_posture: What the null space's spring draws the joints to (n,), [rad].

    Raises:
        ValueError: for impossible values.
    """

    def __init__(self, config: ImpedanceConfig, arm: ArmModel, q_posture: Array) -> None:
        super().__init__()
        name, n = "ImpedanceController", arm.num_joints
        check(config, name)
        if q_posture.shape != (n,):
            raise ValueError(f"{name}: q_posture = {q_posture.tolist()}, need {n} joints, [rad]")
        self._config = config
        self._arm = arm
        self._q_posture = q_posture.copy()
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 2 * n)
        self._desired = self.DeclareAbstractInputPort("motion_desired", Value[object]())
        self._gains = self.DeclareAbstractInputPort("gains_desired", Value[object]())
        self._tare = self.DeclareVectorInputPort("tare", 1)
        torque = self.DeclareDiscreteState(n)
        self._offset = self.DeclareDiscreteState(2 * n)
        self.DeclareStateOutputPort("torque_commanded", torque)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        arm = self._arm.Evaluate(np.asarray(self._joint_state.Eval(context)))
        config = self._config
        desired, gains = self._desired.Eval(context), self._gains.Eval(context)
        rest, zeros = context.get_discrete_state(self._offset).value().reshape(2, -1)
        offset = rest + weight_error(self._arm, arm.q, zeros)
        posture = posture_torque(
            arm, self._q_posture, config.posture_stiffness, config.posture_damping
        )
        if self._tare.HasValue(context) and self._tare.Eval(context)[0] > 0.5:
            spring = gains.stiffness @ se3.log(se3.inverse(arm.X_WE) @ desired.X_WE)
            offset += config.period / config.tare_time * (arm.J_E.T @ spring + posture)
            zeros = likely_zeros(self._arm, arm.q, offset, config)
            rest = offset - weight_error(self._arm, arm.q, zeros)
        damping = bounded_damping(gains.damping, arm, 0.5 / config.period)
        wrench = impedance_wrench(arm, desired, replace(gains, damping=damping))
        torque = arm.J_E.T @ wrench + arm.tau_bias + offset + posture
        limit = config.torque_limit
        next_state.get_mutable_value(0)[:] = np.clip(torque, -limit, limit)
        next_state.get_mutable_value(self._offset)[:] = np.concatenate([rest, zeros])
