"""Velocity-based exploration: pull, and let the object's own freedom bend the path."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.impedance import NO_MOTION, DesiredMotion
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.sequence import Sequence, read
from crossmodal.controllers.interaction.phases import Phase, is_held
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class ExplorationConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # k_p of the paper: displacement of the goal per update and velocity error.
    gain: float = number(0.1, above=0.0, at_most=10.0, unit="s")
    # Desired speed in the pulling direction.
    speed: float = number(0.02, above=0.0, at_most=10.0, unit="m/s")
    # Most by which the goal is ahead of the hand; times the stiffness it is the most pulling force.
    lead: float = number(np.inf, above=0.0, at_most=10.0, unit="m", infinite=True)


def explore_step(X_WE_desired: Array, V_WE_E: Array, V_WE_E_wanted: Array, gain: float) -> Array:
    """The next desired pose, X_des exp(k_p (V_wanted - V_measured)).

    The error has to speed the goal up when the hand lags, so it is wanted minus measured; the
    paper prints the difference the other way round, which pushes the goal backwards.
    Source: crossmodal paper, section VI.
    """
    return X_WE_desired @ se3.exp(gain * (V_WE_E_wanted - V_WE_E))


class ExplorationController(Sequence):
    """Moves the desired pose so that the hand reaches a wanted velocity while it explores.

    p_des(t) = exp(k_p (v_wanted - v_measured)) p_des(t-1), in the pulling direction; the compliant
    directions have nothing to push against, so there the desired pose follows the hand. The first
    p_des(t-1) is the pose that was commanded when the hand had closed.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `motion_commanded`: `DesiredMotion` of the `MotionSwitch`, read when exploration begins.
    - `pull_direction`: (3,) unit vector in E.
    - `speed`: (1,) in the pulling direction, [m/s]; the configured one if not connected.
    - `phase`: (1,) `Phase`; the hand pulls in EXPLORE and wants to stand still in later phases.

    Output ports:
    - `motion_desired`: `DesiredMotion`; `NO_MOTION` before EXPLORE.

    State: the desired motion.

    Args:
        config: Speed and gain.
        arm: The robot's own model.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(self, config: ExplorationConfig, arm: ArmModel) -> None:
        super().__init__(arm)
        check(config, "ExplorationController")
        self._config = config
        self._commanded = self.DeclareAbstractInputPort(
            "motion_commanded", Value[object](NO_MOTION)
        )
        self._direction = self.DeclareVectorInputPort("pull_direction", 3)
        self._speed = self.DeclareVectorInputPort("speed", 1)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._declare_state(NO_MOTION, config.period)
        self._declare_value("motion_desired", NO_MOTION, self._state, self._on_state)

    def _next(self, context: Context) -> DesiredMotion:
        phase = int(self._phase.Eval(context)[0])
        if not is_held(phase):
            return NO_MOTION
        last: DesiredMotion = self._state(context)
        if not last.exists:
            last = self._commanded.Eval(context)
        arm, direction = self._arm_state(context), np.asarray(self._direction.Eval(context))
        wanted = np.zeros(6)
        if phase == Phase.EXPLORE:
            wanted[3:] = float(read(self._speed, context, self._config.speed)[0]) * direction
        along_pull = np.zeros((6, 6))
        along_pull[3:, 3:] = np.outer(direction, direction)
        error = along_pull @ se3.log(se3.inverse(arm.X_WE) @ last.X_WE)
        measured = along_pull @ arm.V_WE_E
        error *= min(1.0, self._config.lead / max(float(np.linalg.norm(error[3:])), 1e-9))
        X_WE = explore_step(arm.X_WE @ se3.exp(error), measured, wanted, self._config.gain)
        return DesiredMotion(X_WE=X_WE, V_WE_E=wanted, A_WE_E=np.zeros(6))
