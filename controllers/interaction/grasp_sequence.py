"""The sequence of a manipulation: approach the taught pose, close the hand, explore, return."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.impedance import NO_MOTION, DesiredMotion, ImpedanceGains
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.minimum_jerk import minimum_jerk
from crossmodal.controllers.arm.sequence import Sequence, read
from crossmodal.controllers.interaction.grasp_decisions import (
    Goal,
    Perceived,
    SequenceState,
    next_state,
    tried_pose,
)
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.controllers.interaction.phases import Phase, is_held
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check


def exploration_gains(
    config: GraspSequenceConfig, direction_E: Array, has_stopped: bool = False
) -> ImpedanceGains:
    """Compliant in all directions, stiff in the pulling direction (3,) of E.

    A hand that has stopped is braked in the compliant directions as while it approaches. If it has
    slipped off, errors of the arm's modelled weight would accelerate it otherwise.
    """
    direction = direction_E / np.linalg.norm(direction_E)
    pull = np.zeros((6, 6))
    pull[3:, 3:] = np.outer(direction, direction)
    free = np.eye(6) - pull
    across = config.compliant_damping * np.eye(6)
    if has_stopped:
        across = stiff_gains(config).damping
    return ImpedanceGains(
        stiffness=config.compliant_stiffness * free + config.pull_stiffness * pull,
        damping=free @ across + config.pull_damping * pull,
        mass=config.mass * np.eye(6),
    )


def stiff_gains(config: GraspSequenceConfig) -> ImpedanceGains:
    """Holds the pose while the hand approaches and closes."""
    stiffness = config.stiff_rotation, config.stiff_translation
    damping = config.stiff_rotation_damping, config.stiff_translation_damping
    return ImpedanceGains(
        stiffness=np.diag(np.repeat(stiffness, 3)),
        damping=np.diag(np.repeat(damping, 3)),
        mass=config.mass * np.eye(6),
    )


def approach_motion(X_WE_grasp: Array, back: Array, s: float, duration: float) -> DesiredMotion:
    """The approach at progress `s` in [0, 1], from `back` (6,), a twist in E, to the grasp."""
    blend, rate, acceleration = minimum_jerk(s)
    return DesiredMotion(
        X_WE=X_WE_grasp @ se3.exp((1.0 - blend) * back),
        V_WE_E=-back * rate / duration,
        A_WE_E=-back * acceleration / duration**2,
    )


def release_motion(X_WE: Array, X_WE_next: Array, back: Array, s: float) -> DesiredMotion:
    """Waits for the hand to open, backs off, then goes straight to the next pose.

    Args:
        X_WE: Where the hand is opened (4, 4).
        X_WE_next: Where the next approach begins (4, 4).
        back: Twist (6,) in E of the way back.
        s: Progress in [0, 1], a third for each part.
    """
    X_back = X_WE @ se3.exp(back)
    X = X_WE @ se3.exp(minimum_jerk(3 * s - 1)[0] * se3.log(se3.inverse(X_WE) @ X_back))
    X = X @ se3.exp(minimum_jerk(3 * s - 2)[0] * se3.log(se3.inverse(X_back) @ X_WE_next))
    return DesiredMotion(X_WE=X, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))


class GraspSequence(Sequence):
    """Says which phase the manipulation is in, and what hand, arm and gains do in it.

    Inputs that are not connected are not known; a sequence without a goal does without them.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `pressure_measured`: (chambers,) gauge pressure in the hand's chambers, [Pa].
    - `joint_remembered`, `end_effector_screw_remembered`: of `JointMemory`.
    - `grasp_failure_latest`: (1,) probability that the hand has lost the body, NaN if unknown.
    - `plan_time_left`: (1,) of `TrajectoryGenerator`, [s].
    - `pull_direction`: (3,) unit vector in E, along which the gains are stiff while exploring.
    - `motion_commanded`: `DesiredMotion` of the `MotionSwitch`, which tells how hard the arm pulls.

    Output ports:
    - `phase`: (1,) `Phase`.
    - `interaction_active`: (1,) one while the hand is closed around the body, as far as it can
      feel.
    - `grasp_lost`: (1,) one from the instant a grasp is given up to the next one.
    - `stuck`: (1,) one once nothing has moved although the hand held on.
    - `in_free_space`: (1,) one while the hand stands still before the object.
    - `motion_desired`: `DesiredMotion` of release and approach, then the grasp pose held.
    - `gains_desired`: `ImpedanceGains`.
    - `pressure_commanded`: (chambers,) gauge pressure, [Pa].
    - `sealed`: (1,) one once the chambers' valves are closed.
    - `closure_commanded`: (1,) 0 open to 1 closed, for the robot's picture of itself.

    State: `SequenceState`.

    Args:
        config: Times, pressures, gains.
        arm: The robot's own model.
        X_WE_grasp: Where the hand closes (4, 4).
        X_WE_before: Where the approach begins (4, 4).
        goal: What ends the exploration, and whether the joint is brought back.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(
        self,
        config: GraspSequenceConfig,
        arm: ArmModel,
        X_WE_grasp: Array,
        X_WE_before: Array,
        goal: Goal | None = None,
    ) -> None:
        super().__init__(arm)
        check(config, "GraspSequence")
        chambers = len(config.closing_pressure)
        self._config = config
        self._back = se3.log(se3.inverse(X_WE_grasp) @ X_WE_before)
        self._goal = goal or Goal()
        self._stiff = stiff_gains(config)
        self._standing = config.standing * config.approach_time
        self._pressure = self.DeclareVectorInputPort("pressure_measured", chambers)
        self._joint = self.DeclareVectorInputPort("joint_remembered", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_remembered", 6)
        self._failure = self.DeclareVectorInputPort("grasp_failure_latest", 1)
        self._time_left = self.DeclareVectorInputPort("plan_time_left", 1)
        self._direction = self.DeclareVectorInputPort("pull_direction", 3)
        self._commanded = self.DeclareAbstractInputPort(
            "motion_commanded", Value[object](NO_MOTION)
        )
        first = SequenceState(
            phase=Phase.APPROACH,
            since=0.0,
            X_WE_start=X_WE_grasp.copy(),
            X_WE_grasp=X_WE_grasp.copy(),
            q_grasp=0.0,
            X_WE_held=X_WE_grasp.copy(),
            pressure_held=np.zeros(chambers),
            task=Phase.EXPLORE,
            attempts=0,
            lost=False,
            stuck=False,
            doubted_since=np.inf,
        )
        self._declare_state(first, config.period)

        def output(name: str, of: Callable[[SequenceState], float]) -> None:
            self._declare_vector(name, 1, lambda context: float(of(self._state(context))))

        output("phase", lambda state: state.phase)
        output("interaction_active", lambda state: is_held(state.phase) and not state.lost)
        output("sealed", lambda state: is_held(state.phase))
        output("grasp_lost", lambda state: state.lost)
        output("stuck", lambda state: state.stuck)
        self._declare_vector("in_free_space", 1, self._calc_in_free_space)
        self._declare_vector("pressure_commanded", chambers, self._calc_pressure)
        self._declare_vector("closure_commanded", 1, self._calc_closure)
        still = approach_motion(X_WE_grasp, self._back, 0.0, 1.0)
        self._declare_value("motion_desired", still, self._calc_motion)
        on_direction = self._on_state | {self._direction.ticket()}
        self._declare_value("gains_desired", self._stiff, self._calc_gains, on_direction)

    def _elapsed(self, context: Context) -> float:
        return context.get_time() - float(self._state(context).since)

    def _calc_pressure(self, context: Context) -> Array:
        closing = self._state(context).phase >= Phase.CLOSE
        return np.asarray(self._config.closing_pressure) * closing

    def _calc_closure(self, context: Context) -> float:
        phase = self._state(context).phase
        closing = min(self._elapsed(context) / (0.5 * self._config.close_time), 1.0)
        return closing if phase == Phase.CLOSE else float(phase > Phase.CLOSE)

    def _calc_in_free_space(self, context: Context) -> float:
        approaching = self._state(context).phase == Phase.APPROACH
        return float(approaching and self._elapsed(context) < self._standing)

    def _calc_motion(self, context: Context) -> DesiredMotion:
        config, state = self._config, self._state(context)
        X_WE_grasp = tried_pose(state, config)
        time = config.approach_time - self._standing
        if state.phase == Phase.RELEASE:
            X_WE_next = approach_motion(X_WE_grasp, self._back, 0.0, time).X_WE
            progress = self._elapsed(context) / config.release_time
            return release_motion(state.X_WE_start, X_WE_next, self._back, progress)
        s = 1.0
        if state.phase == Phase.APPROACH:
            s = max(self._elapsed(context) - self._standing, 0.0) / time
        return approach_motion(X_WE_grasp, self._back, s, time)

    def _calc_gains(self, context: Context) -> ImpedanceGains:
        phase = self._state(context).phase
        if self._config.comply and is_held(phase):
            direction = np.asarray(self._direction.Eval(context))
            return exploration_gains(self._config, direction, phase == Phase.STOP)
        return self._stiff

    def _pull(self, context: Context, X_WE: Array) -> float:
        """The force of the spring along the pull, [N]; NaN where no motion is commanded."""
        if not (self._commanded.HasValue(context) and self._direction.HasValue(context)):
            return np.nan
        commanded: DesiredMotion = self._commanded.Eval(context)
        if not commanded.exists:
            return np.nan
        error = se3.log(se3.inverse(X_WE) @ commanded.X_WE)[3:]
        return float(self._config.pull_stiffness * error @ self._direction.Eval(context))

    def _next(self, context: Context) -> SequenceState:
        X_WE = self._arm_state(context).X_WE
        screw_E = se3.adjoint(se3.inverse(X_WE)) @ read(self._screw, context, np.nan)
        now = Perceived(
            time=context.get_time(),
            X_WE=X_WE,
            pressure=read(self._pressure, context, np.nan),
            pull=self._pull(context, X_WE),
            joint=read(self._joint, context, np.nan),
            hand_rate=float(np.linalg.norm(screw_E[3:])),
            failure=float(read(self._failure, context, np.nan)[0]),
            plan_time_left=float(read(self._time_left, context, np.inf)[0]),
        )
        return next_state(self._state(context), now, self._goal, self._config)
