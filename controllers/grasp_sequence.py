"""The sequence of an exploration: approach the taught pose, close the hand, explore, stop."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from controllers.impedance import DesiredMotion, ImpedanceGains
from controllers.robot_kinematics import ArmModel
from maths import se3

Array = npt.NDArray[np.float64]


class Phase(IntEnum):
    APPROACH = 0
    CLOSE = 1
    EXPLORE = 2
    STOP = 3


@dataclass(kw_only=True)
class GraspSequenceConfig:
    period: float = 0.01  # Update period, [s].
    approach_distance: float = 0.10  # Length of the straight approach along z of E, [m].
    approach_time: float = 2.0  # [s]
    close_time: float = 1.5  # [s]
    explore_time_limit: float = 25.0  # [s]
    travel: float = 0.24  # Way of the hand after which exploration stops, [m].
    stop_time: float = 1.0  # [s]
    # Gauge pressure of index, middle, ring and little, thumb when closed, [Pa].
    closing_pressure: list[float] = field(default_factory=lambda: [6.0e4, 6.0e4, 6.0e4, 8.0e4])
    # While the hand is guided and closed: stiff. Rotation [N m/rad], translation [N/m].
    stiff_rotation: float = 30.0
    stiff_translation: float = 2000.0
    stiff_rotation_damping: float = 1.0  # [N m s/rad]
    stiff_translation_damping: float = 80.0  # [N s/m]
    # While exploring (crossmodal paper, section VII-A): compliant but in the pulling direction.
    compliant_stiffness: float = 0.1  # [N m/rad], [N/m]
    compliant_damping: float = 1.0  # [N m s/rad], [N s/m]
    pull_stiffness: float = 400.0  # [N/m]
    pull_damping: float = 200.0  # [N s/m]
    mass: float = 1.0  # [kg m^2], [kg]
    comply: bool = True  # Whether to switch to the compliant gains once the hand has closed.


def minimum_jerk(s: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of the minimum-jerk blend at s in [0, 1]."""
    s = min(max(s, 0.0), 1.0)
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        s**2 * (30 - 60 * s + 30 * s**2),
        s * (60 - 180 * s + 120 * s**2),
    )


def unit(direction: Array, name: str) -> Array:
    """`direction` (3,) with length one.

    Raises:
        ValueError: if it has no direction, under this `name`.
    """
    length = np.linalg.norm(direction)
    if np.shape(direction) != (3,) or not 0 < length < np.inf:
        raise ValueError(f"{name} = {np.asarray(direction).tolist()}: need 3 numbers, not all zero")
    return np.asarray(direction / length)


def exploration_gains(config: GraspSequenceConfig, direction_E: Array) -> ImpedanceGains:
    """Compliant in all directions, stiff in the pulling direction (3,) of E."""
    direction = unit(direction_E, "direction_E")
    pull = np.zeros((6, 6))
    pull[3:, 3:] = np.outer(direction, direction)
    free = np.eye(6) - pull
    return ImpedanceGains(
        stiffness=config.compliant_stiffness * free + config.pull_stiffness * pull,
        damping=config.compliant_damping * free + config.pull_damping * pull,
        mass=config.mass * np.eye(6),
    )


def stiff_gains(config: GraspSequenceConfig) -> ImpedanceGains:
    """Holds the pose while the hand approaches and closes."""
    ones = np.ones(3)
    return ImpedanceGains(
        stiffness=np.diag(
            np.concatenate([config.stiff_rotation * ones, config.stiff_translation * ones])
        ),
        damping=np.diag(
            np.concatenate(
                [config.stiff_rotation_damping * ones, config.stiff_translation_damping * ones]
            )
        ),
        mass=config.mass * np.eye(6),
    )


def approach_motion(X_WE_grasp: Array, distance: float, s: float, duration: float) -> DesiredMotion:
    """The straight approach along z of E at progress `s` in [0, 1]."""
    blend, rate, acceleration = minimum_jerk(s)
    X_WE = X_WE_grasp @ se3.exp(np.array([0.0, 0, 0, 0, 0, -(1.0 - blend) * distance]))
    along = np.array([0.0, 0, 0, 0, 0, distance])
    return DesiredMotion(
        X_WE=X_WE, V_WE_E=along * rate / duration, A_WE_E=along * acceleration / duration**2
    )


class GraspSequence(LeafSystem):
    """Says which phase the exploration is in, and what hand, arm and gains do in it.

    .. pydrake_system::

        name: GraspSequence
        input_ports:
        - joint_state_measured
        output_ports:
        - phase
        - interaction_active
        - motion_desired
        - gains_commanded
        - pressure_commanded
        - sealed
        - closure_commanded

    - joint_state_measured: (14,) positions [rad] and velocities [rad/s].
    - phase: (1,) `Phase`.
    - interaction_active: (1,) one once the hand has closed.
    - motion_desired: `DesiredMotion` of the approach, then the grasp pose held.
    - gains_commanded: `ImpedanceGains`.
    - pressure_commanded: (4,) gauge pressure, [Pa].
    - sealed: (1,) one once the chambers' valves are closed.
    - closure_commanded: (1,) 0 open to 1 closed, for the robot's picture of itself.

    State: phase, the time it began [s], and where the end-effector was then (3,) [m].

    Args:
        config: Times, pressures, gains.
        arm: The robot's own model.
        X_WE_grasp: Where the hand closes (4, 4).
        direction_E: Of the pull (3,), in E.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(
        self, config: GraspSequenceConfig, arm: ArmModel, X_WE_grasp: Array, direction_E: Array
    ) -> None:
        super().__init__()
        for name in ("period", "approach_time", "close_time", "explore_time_limit", "travel"):
            if not getattr(config, name) > 0:
                raise ValueError(f"GraspSequence: need {name} > 0, got {getattr(config, name)!r}")
        self._config = config
        self._arm = arm
        self._X_WE_grasp = X_WE_grasp.copy()
        self._stiff = stiff_gains(config)
        self._compliant = exploration_gains(config, direction_E) if config.comply else self._stiff
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 14)
        state = self.DeclareDiscreteState(5)
        on_state = {self.discrete_state_ticket(state)}
        on_time = on_state | {self.time_ticket()}

        def vector(name: str, size: int, calc: object) -> None:
            self.DeclareVectorOutputPort(name, size, calc, on_time)

        vector("phase", 1, lambda c, out: out.SetAtIndex(0, self._phase(c)))
        vector(
            "interaction_active",
            1,
            lambda c, out: out.SetAtIndex(0, float(self._phase(c) >= Phase.EXPLORE)),
        )
        vector("pressure_commanded", 4, self._calc_pressure)
        vector(
            "sealed", 1, lambda c, out: out.SetAtIndex(0, float(self._phase(c) >= Phase.EXPLORE))
        )
        vector("closure_commanded", 1, self._calc_closure)
        still = approach_motion(X_WE_grasp, config.approach_distance, 0.0, 1.0)
        self.DeclareAbstractOutputPort(
            "motion_desired", lambda: Value[object](still), self._calc_motion, on_time
        )
        self.DeclareAbstractOutputPort(
            "gains_commanded", lambda: Value[object](self._stiff), self._calc_gains, on_state
        )
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _phase(self, context: Context) -> int:
        return int(context.get_discrete_state_vector()[0])

    def _elapsed(self, context: Context) -> float:
        return context.get_time() - context.get_discrete_state_vector()[1]

    def _calc_pressure(self, context: Context, output: BasicVector) -> None:
        closing = self._phase(context) >= Phase.CLOSE
        output.SetFromVector(np.asarray(self._config.closing_pressure) * closing)

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        phase = self._phase(context)
        closing = min(self._elapsed(context) / (0.5 * self._config.close_time), 1.0)
        output.SetAtIndex(0, closing if phase == Phase.CLOSE else float(phase > Phase.CLOSE))

    def _calc_motion(self, context: Context, output: AbstractValue) -> None:
        config = self._config
        s = 1.0
        if self._phase(context) == Phase.APPROACH:
            s = self._elapsed(context) / config.approach_time
        output.set_value(
            approach_motion(self._X_WE_grasp, config.approach_distance, s, config.approach_time)
        )

    def _calc_gains(self, context: Context, output: AbstractValue) -> None:
        exploring = self._phase(context) >= Phase.EXPLORE
        output.set_value(self._compliant if exploring else self._stiff)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        config = self._config
        state = np.array(context.get_discrete_state_vector().value())
        phase, elapsed = Phase(int(state[0])), context.get_time() - state[1]
        p_WE = self._arm.Evaluate(np.asarray(self._joint_state.Eval(context))).X_WE[:3, 3]
        done = {
            Phase.APPROACH: elapsed >= config.approach_time,
            Phase.CLOSE: elapsed >= config.close_time,
            Phase.EXPLORE: elapsed >= config.explore_time_limit
            or np.linalg.norm(p_WE - state[2:]) >= config.travel,
            Phase.STOP: False,
        }[phase]
        if done:
            state[:2] = phase + 1, context.get_time()
            state[2:] = p_WE
        next_state.get_mutable_vector().SetFromVector(state)
