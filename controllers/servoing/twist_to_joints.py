"""Joint positions that make the fingertip move as it should."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.twists import in_world
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class TwistToJointsConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Share of the joints' velocity limits that is used.
    velocity_share: float = number(0.5, above=0.0, at_most=1.0)
    # Distance that is kept from the joints' limits.
    margin: float = number(0.02, at_least=0.0, at_most=1.0, unit="rad")
    # Gain that draws the null space to the posture.
    centering: float = number(0.0, at_least=0.0, at_most=10.0, unit="1/s")
    # By how much a command may lead the measured joint.
    lead: float = number(0.05, above=0.0, at_most=1.0, unit="rad")


def inverse_parameters(
    config: TwistToJointsConfig, model: MultibodyPlant
) -> DifferentialInverseKinematicsParameters:
    """What Drake's differential inverse kinematics keeps to: the limits that the model declares."""
    n = model.num_positions()
    parameters = DifferentialInverseKinematicsParameters(n, n)
    parameters.set_time_step(config.period)
    parameters.set_joint_centering_gain(config.centering * np.eye(n))
    lower, upper = model.GetPositionLowerLimits(), model.GetPositionUpperLimits()
    parameters.set_joint_position_limits((lower + config.margin, upper - config.margin))
    speed = config.velocity_share * model.GetVelocityUpperLimits()
    parameters.set_joint_velocity_limits((-speed, speed))
    return parameters


def joint_velocities(
    q: Array,
    J: Array,
    V: Array,
    parameters: DifferentialInverseKinematicsParameters,
) -> tuple[Array, float]:
    """Joint velocities (n,) for a twist V (6,) or the largest share of it, and that share.

    Without a solution both are zero.
    """
    result = DoDifferentialInverseKinematics(q, np.zeros_like(q), V, J, parameters)
    if result.status == DifferentialInverseKinematicsStatus.kNoSolutionFound:
        return np.zeros_like(q), 0.0
    v = np.asarray(result.joint_velocities)
    size = float(V @ V)
    return v, float(np.clip(V @ J @ v / size, 0.0, 1.0)) if size > 0.0 else 1.0


class TwistToJoints(LeafSystem):
    """Integrates the joint velocities of a desired twist to joint positions.

    J(q) v = share V, with the largest share for which v and q keep the joints' limits, by Drake's
    differential inverse kinematics at the commanded q. The command never leads the measured joints
    by more than a limit, so that an arm that is held up does not jump when it is set free.

    Input ports:
    - `twist_desired`: (6,) V_WS_S, [rad/s, m/s].
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].

    Output ports:
    - `joint_position_commanded`: (n,) [rad], held over the period.
    - `twist_share`: (1,) what the arm can do of the twist, as of the last period: one if all, zero
      if nothing. While the command is held back by `lead` it is zero.

    State: the commanded q (n,) and the share (1,).

    Frames: W world, S fingertip.

    Args:
        config: Limits.
        arm: The arm's own model with its joints' limits, its end-effector the fingertip S.
        q_initial: First command and posture of the null space (n,), [rad].

    Raises:
        ValueError: for an impossible config value, or a posture beyond the limits.
    """

    def __init__(self, config: TwistToJointsConfig, arm: ArmModel, q_initial: Array) -> None:
        super().__init__()
        name, n = "TwistToJoints", arm.num_joints
        check(config, name)
        self._parameters = inverse_parameters(config, arm.plant)
        lower, upper = self._parameters.get_joint_position_limits()
        if q_initial.shape != (n,) or not np.all((lower <= q_initial) & (q_initial <= upper)):
            raise ValueError(
                f"{name}: q_initial = {q_initial.tolist()} rad, need {n} joints from"
                f" {lower.tolist()} to {upper.tolist()}"
            )
        self._config, self._arm = config, arm
        self._parameters.set_nominal_joint_position(q_initial)
        self._twist = self.DeclareVectorInputPort("twist_desired", 6)
        self._joints = self.DeclareVectorInputPort("joint_state_measured", 2 * n)
        command = self.DeclareDiscreteState(q_initial)
        share = self.DeclareDiscreteState([1.0])
        self.DeclareStateOutputPort("joint_position_commanded", command)
        self.DeclareStateOutputPort("twist_share", share)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        config, n = self._config, self._arm.num_joints
        q = np.array(context.get_discrete_state(0).value())
        V_WS_S = np.asarray(self._twist.Eval(context))
        measured = np.asarray(self._joints.Eval(context))[:n]
        arm = self._arm.Evaluate(np.concatenate([q, np.zeros(n)]))
        R_SW = arm.X_WE[:3, :3]
        J_W = np.vstack([R_SW @ arm.J_E[:3], R_SW @ arm.J_E[3:]])
        v, share = joint_velocities(q, J_W, in_world(arm.X_WE, V_WS_S), self._parameters)
        free = q + config.period * v
        command = np.clip(free, measured - config.lead, measured + config.lead)
        command = np.clip(command, *self._parameters.get_joint_position_limits())
        if not np.array_equal(command, free):
            share = 0.0
        next_state.get_mutable_value(0)[:] = command
        next_state.get_mutable_value(1)[:] = share
