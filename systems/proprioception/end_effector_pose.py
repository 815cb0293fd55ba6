"""Where the end-effector of a well calibrated arm is."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.arm_pose import ArmPose, joints_at, offset_variances
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    EndEffectorBelief,
    SampleWindow,
    no_samples,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class EndEffectorPoseConfig(Ticked):
    noise = SensorNoise()
    # Velocity of an arm that holds something still, 1 sigma.
    angular_velocity: float = number(0.01, at_least=1e-9, at_most=100.0, unit="rad/s")
    # Velocity along an axis of such an arm, 1 sigma.
    linear_velocity: float = number(0.005, at_least=1e-9, at_most=100.0, unit="m/s")


def end_effector_belief(
    X_WE: Array, white: Array, lasting: Array, config: EndEffectorPoseConfig
) -> EndEffectorBelief:
    """The belief in a pose whose errors are known; its velocity is zero."""
    speeds = np.repeat([config.angular_velocity, config.linear_velocity], 3)
    covariance = np.zeros((12, 12))
    covariance[:6, :6] = white + lasting
    covariance[6:, 6:] = np.diag(speeds**2)
    values, vectors = np.linalg.eigh(lasting)
    return EndEffectorBelief(
        X=X_WE,
        V=np.zeros(6),
        covariance=covariance,
        bias_jacobian=vectors * np.sqrt(np.maximum(values, 0.0)),
    )


class EndEffectorPose(RecursiveFilter):
    """Where the end-effector of an arm that holds something still is, by its own kinematics.

    Other than `EndEffectorMotion` it knows where its error comes from: the calibration of its base
    and of its joints' zeros.

    Input ports:
    - `joint_state_window`: `SampleWindow` of (2 n,) positions [rad], velocities [rad/s].

    Output ports:
    - `end_effector_estimated`: `EndEffectorBelief` of this tick; the last one without samples.
    - `end_effector_latest`: the one of the last tick, from the state.

    Args:
        arm: Its kinematics with their errors.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(self, config: EndEffectorPoseConfig, arm: ArmPose) -> None:
        super().__init__()
        check(config, "EndEffectorPose")
        self._config, self._arm = config, arm
        none = no_samples(2 * arm.num_joints)
        self._window = self._declare_value_input("joint_state_window", none)
        self._declare_recursion(UNKNOWN_END_EFFECTOR, self._calc_pose, config.period)
        self._declare_estimated("end_effector_estimated", lambda belief: belief)
        self._declare_latest("end_effector_latest", lambda belief: belief)

    def _calc_pose(self, context: Context, belief: EndEffectorBelief) -> EndEffectorBelief:
        window: SampleWindow = self._read(self._window, context)
        if len(window.times) == 0:
            return belief
        config = self._config
        q, variance = joints_at(
            window.times - context.get_time(),
            window.values,
            config.noise.angle,
            config.noise.rate,
        )
        return end_effector_belief(
            *self._arm.Evaluate(q, variance, offset_variances(window)), config
        )
