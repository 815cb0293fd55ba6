"""The sequence of a manipulation: approach the taught pose, close the hand, explore, return."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from controllers.impedance import DesiredMotion, ImpedanceGains
from controllers.phases import Phase, is_held
from controllers.robot_kinematics import ArmModel
from maths import se3

Array = npt.NDArray[np.float64]


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
    anticipation: float = 0.1  # Between the joint's motion and the hand's stop for it, [s].
    # The return ends once the perceived joint is as near as this to its start, as way of the hand.
    return_tolerance: float = 0.002  # [m]
    return_patience: float = 3.0  # How long after the planned end it may still be late, [s].
    # A grasp is given up once it has been doubted so long: when it is believed to have failed and
    # the hand is not where the perceived joint would have taken it. The return is finished first.
    doubt_time: float = 1.0  # [s]
    failure_probability: float = 0.5
    slip: float = 0.06  # [m]
    # A hand that holds nothing curls up: once the sealed pressure in every chamber has fallen to
    # this share of what it was around the handle, the grasp is lost. Around a bar it keeps 0.88 and
    # more; a hand that curls past an edge and pushes it falls to 0.7, as an empty one does.
    empty_pressure: float = 0.8
    retries: int = 2  # How often a lost grasp is tried again,
    retry_distance: float = 0.12  # where the hand is still as near to the handle as this, [m].
    release_time: float = 4.0  # For opening the hand, backing off and going before the handle, [s].
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


def moved_by_joint(X_WE: Array, joint: Array, q: float) -> Array:
    """Where the joint, (8,) S_W, q and its rate, has taken a pose of E that it had at another q."""
    if np.isnan(joint[6]):
        return X_WE
    return np.asarray(se3.exp(joint[:6] * (joint[6] - q)) @ X_WE)


@dataclass(kw_only=True)
class SequenceState:
    """Never written after it is made.

    Attributes:
        phase: What is done,
        since: since when, [s],
        X_WE_start: and where the end-effector was then (4, 4).
        X_WE_grasp: Where the hand closes or has closed (4, 4), and
        q_grasp: the joint's perceived configuration there, [m or rad].
        X_WE_held: Where the end-effector was when it had closed (4, 4), with
        pressure_held: the chambers' pressure (4,), [Pa].
        task: EXPLORE, or RETURN once exploration is over.
        attempts: Grasps tried again.
        lost: Whether the grasp is believed lost.
        doubted_since: Since when the grasp has been doubted, infinite while it is not, [s].
    """

    phase: Phase
    since: float
    X_WE_start: Array
    X_WE_grasp: Array
    q_grasp: float
    X_WE_held: Array
    pressure_held: Array
    task: Phase
    attempts: int
    lost: bool
    doubted_since: float

    def __deepcopy__(self, memo: dict[int, object]) -> "SequenceState":
        return self


@dataclass(kw_only=True)
class Perceived:
    """What the sequence decides by, at one instant.

    Attributes:
        time: [s]
        X_WE: The end-effector's measured pose (4, 4).
        pressure: Measured in the chambers (4,), [Pa]; NaN where it is not known.
        joint: (8,) the body's unit screw S_W, q and its rate; NaN until a joint is perceived, the
            rate whenever it is only remembered.
        hand_rate: Way of the hand per unit of q, [m per m or rad]; NaN likewise.
        failure: Probability that the hand has lost the body, NaN where nobody can tell.
        plan_time_left: Until the planned end of the return, [s].
    """

    time: float
    X_WE: Array
    pressure: Array
    joint: Array
    hand_rate: float
    failure: float
    plan_time_left: float


@dataclass(kw_only=True)
class Goal:
    """What a manipulation is for.

    Attributes:
        travel: Perceived travel of the joint at which exploration ends, [m or rad]; None ends it by
            the hand's way.
        return_to_start: Whether the joint is then brought back to where it was.
    """

    travel: float | None = None
    return_to_start: bool = False


def is_doubtful(state: SequenceState, now: Perceived, config: GraspSequenceConfig) -> bool:
    """Whether the hand seems to hold nothing: each sign alone may be an error of perception."""
    if np.isnan(now.joint[7]) and not np.isnan(now.joint[6]):
        return False
    X_WE = moved_by_joint(state.X_WE_held, now.joint, state.q_grasp)
    slip = np.linalg.norm(X_WE[:3, 3] - now.X_WE[:3, 3])
    believed = np.isnan(now.failure) or now.failure > config.failure_probability
    return bool(believed and slip > config.slip)


def is_empty(state: SequenceState, now: Perceived, config: GraspSequenceConfig) -> bool:
    """Whether every finger has curled further than it could around the handle."""
    return bool(np.all(now.pressure < config.empty_pressure * state.pressure_held))


def next_state(
    state: SequenceState, now: Perceived, goal: Goal, config: GraspSequenceConfig
) -> SequenceState:
    """One step of the sequence."""
    elapsed = now.time - state.since
    ends = {
        Phase.RELEASE: config.release_time,
        Phase.APPROACH: config.approach_time,
        Phase.CLOSE: config.close_time,
        Phase.EXPLORE: config.explore_time_limit,
    }
    over = elapsed >= ends.get(state.phase, np.inf)
    if state.phase == Phase.STOP:
        return state
    if state.phase < Phase.CLOSE:
        return _enter(state, Phase(state.phase + 1), now) if over else state
    if state.phase == Phase.CLOSE:
        if not over:
            return state
        state = _enter(state, state.task, now)
        return replace(state, X_WE_held=now.X_WE, pressure_held=now.pressure)
    if goal.travel is not None:
        doubted = is_doubtful(state, now, config)
        since = min(state.doubted_since, now.time) if doubted else np.inf
        state = replace(state, doubted_since=since)
    doubted_long = now.time - state.doubted_since >= config.doubt_time
    lost = doubted_long or is_empty(state, now, config)
    if state.phase == Phase.RETURN:
        late = now.plan_time_left <= -config.return_patience
        there = abs(now.joint[6]) * now.hand_rate <= config.return_tolerance
        over = (late or lost or bool(there)) and now.plan_time_left <= 0.0
        if over and lost and not there:
            return _lose_grasp(state, now, goal, config)
        return _enter(state, Phase.STOP, now) if over else state
    if lost:
        return _lose_grasp(state, now, goal, config)
    known = not np.isnan(now.joint[6])
    way = float(np.linalg.norm(now.X_WE[:3, 3] - state.X_WE_start[:3, 3]))
    over = (over or way >= config.travel) and np.isinf(state.doubted_since)
    if goal.travel is not None and known:
        q = now.joint[6] + config.anticipation * np.nan_to_num(now.joint[7])
        over = over or bool(abs(q) >= goal.travel)
    if not over:
        return state
    if goal.travel is not None and not known:
        return _lose_grasp(state, now, goal, config)
    following = Phase.RETURN if goal.return_to_start else Phase.STOP
    return replace(_enter(state, following, now), task=following)


def _enter(state: SequenceState, phase: Phase, now: Perceived) -> SequenceState:
    return replace(
        state,
        phase=phase,
        since=now.time,
        X_WE_start=now.X_WE,
        lost=state.lost and not is_held(phase),
        doubted_since=np.inf,
    )


def _lose_grasp(
    state: SequenceState, now: Perceived, goal: Goal, config: GraspSequenceConfig
) -> SequenceState:
    """Goes back to the handle where the hand is near and has not tried too often, else stops.

    Without a perceived goal nobody knows where the handle has gone, so it stops.
    """
    X_WE_grasp = moved_by_joint(state.X_WE_grasp, now.joint, state.q_grasp)
    near = np.linalg.norm(X_WE_grasp[:3, 3] - now.X_WE[:3, 3]) <= config.retry_distance
    if goal.travel is None or not near or state.attempts >= config.retries:
        return replace(_enter(state, Phase.STOP, now), lost=True)
    return replace(
        _enter(state, Phase.RELEASE, now),
        lost=True,
        X_WE_grasp=X_WE_grasp,
        q_grasp=0.0 if np.isnan(now.joint[6]) else float(now.joint[6]),
        attempts=state.attempts + 1,
    )


class GraspSequence(LeafSystem):
    """Says which phase the manipulation is in, and what hand, arm and gains do in it.

    .. pydrake_system::

        name: GraspSequence
        input_ports:
        - joint_state_measured
        - pressure_measured
        - joint_remembered
        - end_effector_screw_remembered
        - grasp_failure_latest
        - plan_time_left
        output_ports:
        - phase
        - interaction_active
        - grasp_lost
        - motion_desired
        - gains_desired
        - pressure_commanded
        - sealed
        - closure_commanded

    - joint_state_measured: (14,) positions [rad] and velocities [rad/s].
    - pressure_measured: (4,) gauge pressure in the chambers, [Pa].
    - joint_remembered, end_effector_screw_remembered: of `JointMemory`.
    - grasp_failure_latest: (1,) probability that the hand has lost the body, NaN if unknown.
    - plan_time_left: (1,) of `TrajectoryGenerator`, [s].
    - What is not connected is not known; without a goal to be perceived nothing of it is read.
    - phase: (1,) `Phase`.
    - interaction_active: (1,) one while the hand is closed around the body, as far as it can feel.
    - grasp_lost: (1,) one from the instant a grasp is given up to the next one.
    - motion_desired: `DesiredMotion` of release and approach, then the grasp pose held.
    - gains_desired: `ImpedanceGains`.
    - pressure_commanded: (4,) gauge pressure, [Pa].
    - sealed: (1,) one once the chambers' valves are closed.
    - closure_commanded: (1,) 0 open to 1 closed, for the robot's picture of itself.

    State: `SequenceState`.

    Args:
        config: Times, pressures, gains.
        arm: The robot's own model.
        X_WE_grasp: Where the hand closes (4, 4).
        X_WE_before: Where the approach begins (4, 4).
        direction_E: Of the pull (3,), in E.
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
        direction_E: Array,
        goal: Goal | None = None,
    ) -> None:
        super().__init__()
        for name in (
            "period",
            "approach_time",
            "close_time",
            "explore_time_limit",
            "travel",
            "return_tolerance",
            "slip",
            "release_time",
        ):
            if not getattr(config, name) > 0:
                raise ValueError(f"GraspSequence: need {name} > 0, got {getattr(config, name)!r}")
        if not 0.0 < config.empty_pressure < 1.0:
            raise ValueError(
                f"GraspSequence: need empty_pressure between 0 and 1, got {config.empty_pressure!r}"
            )
        self._config = config
        self._arm = arm
        self._back = se3.log(se3.inverse(X_WE_grasp) @ X_WE_before)
        self._goal = goal or Goal()
        self._stiff = stiff_gains(config)
        self._compliant = exploration_gains(config, direction_E) if config.comply else self._stiff
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 14)
        self._pressure = self.DeclareVectorInputPort("pressure_measured", 4)
        self._joint = self.DeclareVectorInputPort("joint_remembered", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_remembered", 6)
        self._failure = self.DeclareVectorInputPort("grasp_failure_latest", 1)
        self._time_left = self.DeclareVectorInputPort("plan_time_left", 1)
        first = SequenceState(
            phase=Phase.APPROACH,
            since=0.0,
            X_WE_start=X_WE_grasp.copy(),
            X_WE_grasp=X_WE_grasp.copy(),
            q_grasp=0.0,
            X_WE_held=X_WE_grasp.copy(),
            pressure_held=np.zeros(4),
            task=Phase.EXPLORE,
            attempts=0,
            lost=False,
            doubted_since=np.inf,
        )
        state = self.DeclareAbstractState(Value[object](first))
        on_state = {self.abstract_state_ticket(state)}
        on_time = on_state | {self.time_ticket()}

        def vector(name: str, size: int, calc: object) -> None:
            self.DeclareVectorOutputPort(name, size, calc, on_time)

        def flag(name: str, of: Callable[[SequenceState], bool]) -> None:
            vector(name, 1, lambda c, out: out.SetAtIndex(0, float(of(self._state(c)))))

        vector("phase", 1, lambda c, out: out.SetAtIndex(0, float(self._state(c).phase)))
        flag("interaction_active", lambda state: is_held(state.phase) and not state.lost)
        flag("sealed", lambda state: is_held(state.phase))
        flag("grasp_lost", lambda state: state.lost)
        vector("pressure_commanded", 4, self._calc_pressure)
        vector("closure_commanded", 1, self._calc_closure)
        still = approach_motion(X_WE_grasp, self._back, 0.0, 1.0)
        self.DeclareAbstractOutputPort(
            "motion_desired", lambda: Value[object](still), self._calc_motion, on_time
        )
        self.DeclareAbstractOutputPort(
            "gains_desired", lambda: Value[object](self._stiff), self._calc_gains, on_state
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(config.period, 0.0, self._update)

    def _state(self, context: Context) -> SequenceState:
        state: SequenceState = context.get_abstract_state(0).get_value()
        return state

    def _elapsed(self, context: Context) -> float:
        return context.get_time() - self._state(context).since

    def _calc_pressure(self, context: Context, output: BasicVector) -> None:
        closing = self._state(context).phase >= Phase.CLOSE
        output.SetFromVector(np.asarray(self._config.closing_pressure) * closing)

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        phase = self._state(context).phase
        closing = min(self._elapsed(context) / (0.5 * self._config.close_time), 1.0)
        output.SetAtIndex(0, closing if phase == Phase.CLOSE else float(phase > Phase.CLOSE))

    def _calc_motion(self, context: Context, output: AbstractValue) -> None:
        config, state = self._config, self._state(context)
        time = config.approach_time
        if state.phase == Phase.RELEASE:
            X_WE_next = approach_motion(state.X_WE_grasp, self._back, 0.0, time).X_WE
            progress = self._elapsed(context) / config.release_time
            output.set_value(release_motion(state.X_WE_start, X_WE_next, self._back, progress))
            return
        s = self._elapsed(context) / time if state.phase == Phase.APPROACH else 1.0
        output.set_value(approach_motion(state.X_WE_grasp, self._back, s, time))

    def _calc_gains(self, context: Context, output: AbstractValue) -> None:
        exploring = is_held(self._state(context).phase)
        output.set_value(self._compliant if exploring else self._stiff)

    def _update(self, context: Context, state: State) -> None:
        def read(port: InputPort, unknown: float) -> Array:
            if port.HasValue(context):
                return np.asarray(port.Eval(context))
            return np.full(port.size(), unknown)

        X_WE = self._arm.Evaluate(np.asarray(self._joint_state.Eval(context))).X_WE
        screw_E = se3.adjoint(se3.inverse(X_WE)) @ read(self._screw, np.nan)
        now = Perceived(
            time=context.get_time(),
            X_WE=X_WE,
            pressure=read(self._pressure, np.nan),
            joint=read(self._joint, np.nan),
            hand_rate=float(np.linalg.norm(screw_E[3:])),
            failure=float(read(self._failure, np.nan)[0]),
            plan_time_left=float(read(self._time_left, np.inf)[0]),
        )
        following = next_state(self._state(context), now, self._goal, self._config)
        state.get_mutable_abstract_state(0).set_value(following)
