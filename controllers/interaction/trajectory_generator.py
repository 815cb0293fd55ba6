"""Plans with the perceived joint: brings it back to its start, online."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.impedance import NO_GAINS, NO_MOTION, DesiredMotion, ImpedanceGains
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.minimum_jerk import PEAK_RATE, minimum_jerk
from crossmodal.controllers.arm.sequence import Sequence, read
from crossmodal.controllers.interaction.joint_memory import is_revolute
from crossmodal.controllers.interaction.phases import Phase, is_held
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class TrajectoryGeneratorConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Highest planned speed of the hand.
    speed: float = number(0.04, at_least=1e-6, at_most=10.0, unit="m/s")
    # Gain that draws the perceived joint onto the plan.
    feedback: float = number(1.0, above=0.0, at_most=1000.0, unit="1/s")
    # Of the grasp, above which the feedback is off.
    failure_probability: float = number(0.5, at_least=0.0, at_most=1.0)
    # Largest distance of the plan ahead of the hand.
    lead: float = number(0.03, above=0.0, at_most=10.0, unit="m")
    # Along the hand's motion.
    stiffness_along: float = number(1000.0, at_least=0.0, at_most=1e6, unit="N/m")
    # Across the hand's motion.
    stiffness_across: float = number(200.0, at_least=0.0, at_most=1e6, unit="N/m")
    # About each axis.
    stiffness_rotation: float = number(10.0, at_least=0.0, at_most=1e4, unit="N m/rad")
    # Along the hand's motion.
    damping_along: float = number(150.0, at_least=0.0, at_most=1e5, unit="N s/m")
    # Across the hand's motion.
    damping_across: float = number(60.0, at_least=0.0, at_most=1e5, unit="N s/m")
    # About each axis.
    damping_rotation: float = number(1.0, at_least=0.0, at_most=1e4, unit="N m s/rad")
    # Inertia that the hand seems to have, about and along each axis.
    mass: float = number(1.0, at_least=0.0, at_most=1000.0, unit="kg m^2 or kg")


@dataclass(kw_only=True)
class Plan(Immutable):
    """The joint's path to its start by minimum jerk; never written after it is made.

    Attributes:
        start: When it begins, [s].
        duration: [s]
        q_start: Configuration of the joint at its beginning, [m or rad]; the goal is zero.
        revolute: Whether q is an angle.
        motion: The end-effector's desired motion at the last update.
        gains: The gains that go with it.
    """

    start: float
    duration: float
    q_start: float
    revolute: bool
    motion: DesiredMotion
    gains: ImpedanceGains

    @property
    def exists(self) -> bool:
        """False for `NO_PLAN`."""
        return self.motion.exists

    def joint(self, time: float) -> tuple[float, float]:
        """Planned configuration [m or rad] and its rate."""
        blend, rate, _ = minimum_jerk((time - self.start) / self.duration)
        return self.q_start * (1.0 - blend), -self.q_start * rate / self.duration


NO_PLAN = Plan(
    start=np.inf, duration=0.0, q_start=np.nan, revolute=False, motion=NO_MOTION, gains=NO_GAINS
)


def plan_duration(q: float, hand_rate: float, speed: float) -> float:
    """How long the path from q to zero takes, [s], if the hand moves at `speed` [m/s] at most."""
    return max(PEAK_RATE * abs(q) * hand_rate / speed, 0.5)


def path_gains(S_E: Array, config: TrajectoryGeneratorConfig) -> ImpedanceGains:
    """Stiff where the end-effector is to go, compliant across.

    Args:
        S_E: Its wanted twist (6,) in E, of any length.
    """
    direction = S_E[3:] / max(float(np.linalg.norm(S_E[3:])), 1e-9)
    along = np.zeros((6, 6))
    along[3:, 3:] = np.outer(direction, direction)

    def matrix(rotation: float, across: float, stiff: float) -> Array:
        return np.asarray(np.diag([rotation] * 3 + [across] * 3) + (stiff - across) * along)

    return ImpedanceGains(
        stiffness=matrix(
            config.stiffness_rotation, config.stiffness_across, config.stiffness_along
        ),
        damping=matrix(config.damping_rotation, config.damping_across, config.damping_along),
        mass=config.mass * np.eye(6),
    )


def advance(
    plan: Plan,
    X_WE: Array,
    screw_W: Array,
    q: float | None,
    time: float,
    config: TrajectoryGeneratorConfig,
) -> Plan:
    """The next desired pose, X_des(t + dt) = exp(S_WE u dt) X_des(t).

    With u = qdot_plan + k (q_plan - q) the perceived joint is drawn onto the plan, whatever hand
    and handle yield. Only the rest of the path follows the newest screw: nothing jumps when the
    estimate gets better. While the joint is not perceived in the hand, k is zero; where the hand
    cannot follow, the plan waits.

    Args:
        plan: As of the last update.
        X_WE: The end-effector's measured pose.
        screw_W: The end-effector's twist (6,) in W at Wo per unit of q, by the latest estimates.
        q: Perceived configuration, [m or rad]; None while it is not perceived.
        time: Of the update, [s].
    """
    q_plan, rate = plan.joint(time)
    u = rate if q is None else rate + config.feedback * (q_plan - q)
    S_E = se3.adjoint(se3.inverse(X_WE)) @ screw_W
    hand_rate = max(float(np.linalg.norm(S_E[3:])), 1e-6)
    ahead = se3.log(se3.inverse(X_WE) @ plan.motion.X_WE)[3:] @ S_E[3:] / hand_rate
    if ahead * np.sign(u) >= config.lead:
        u = 0.0
    limit = 1.5 * config.speed / hand_rate
    u = float(np.clip(u, -limit, limit))
    X_next = se3.exp(screw_W * (u * config.period)) @ plan.motion.X_WE
    V_WE_E = se3.adjoint(se3.inverse(X_next)) @ screw_W * u
    motion = DesiredMotion(X_WE=X_next, V_WE_E=V_WE_E, A_WE_E=np.zeros(6))
    return replace(plan, motion=motion, gains=path_gains(S_E, config))


_NO_PATH = np.zeros((0, 4, 4))


class TrajectoryGenerator(Sequence):
    """Online trajectory generator: exploits the perceived joint to bring it back to its start.

    In RETURN, it interpolates the joint from where it is perceived to zero. The body moves along
    its screw, V_WB = S_W qdot, and as grasp and bending say which part of that the hand has to
    follow, the end-effector moves with V_WE = S_WE qdot. The path is the integral of it from where
    the hand is; each update reads the latest screw and the latest configuration.

    After RETURN the pose is held.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `phase`: (1,) `Phase`.
    - `joint_remembered`: (8,) of `JointMemory`, of which the type and q [m or rad] are used.
    - `end_effector_screw_remembered`: (6,) S_WE, in W at Wo, per unit of q.
    - `grasp_failure_latest`: (1,) probability that the hand has lost the body; NaN or unconnected
      if unknown.

    Output ports:
    - `motion_desired`, `gains_desired`: `DesiredMotion` and `ImpedanceGains`; `NO_MOTION` and
      `NO_GAINS` without a plan.
    - `plan_time_left`: (1,) until the planned end, negative after it; infinite without a plan, [s].
    - `path_planned`: poses (N, 4, 4) of E in W from now to the goal by the latest screw; N = 0
      without a plan.

    State: `Plan`. Source: crossmodal paper, section VI.

    Args:
        config: Speed, gains and feedback.
        arm: The robot's own model.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(self, config: TrajectoryGeneratorConfig, arm: ArmModel) -> None:
        super().__init__(arm)
        check(config, "TrajectoryGenerator")
        self._config = config
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._joint = self.DeclareVectorInputPort("joint_remembered", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_remembered", 6)
        self._failure = self.DeclareVectorInputPort("grasp_failure_latest", 1)
        self._declare_state(NO_PLAN, config.period)
        value, on_state = self._declare_value, self._on_state
        value("motion_desired", NO_MOTION, lambda c: self._state(c).motion, on_state)
        value("gains_desired", NO_GAINS, lambda c: self._state(c).gains, on_state)
        self._declare_vector("plan_time_left", 1, self._calc_time_left)
        value("path_planned", _NO_PATH, self._calc_path, {self.all_sources_ticket()})

    def _next(self, context: Context) -> Plan:
        phase, plan = self._phase.Eval(context)[0], self._state(context)
        if not is_held(phase):
            return NO_PLAN
        if not plan.exists and phase != Phase.RETURN:
            return plan
        time, joint = context.get_time(), np.asarray(self._joint.Eval(context))
        q = float(joint[6])
        screw_W = np.asarray(self._screw.Eval(context))
        X_WE = self._arm_state(context).X_WE
        revolute = is_revolute(joint)
        if not plan.exists or plan.revolute != revolute:
            still = DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
            S_E = se3.adjoint(se3.inverse(X_WE)) @ screw_W
            plan = Plan(
                start=time,
                duration=plan_duration(q, float(np.linalg.norm(S_E[3:])), self._config.speed),
                q_start=q,
                revolute=revolute,
                motion=plan.motion if plan.exists else still,
                gains=path_gains(S_E, self._config),
            )
        failed = read(self._failure, context, np.nan)[0] > self._config.failure_probability
        perceived = None if failed or np.isnan(joint[7]) else q
        return advance(plan, X_WE, screw_W, perceived, time, self._config)

    def _calc_time_left(self, context: Context) -> float:
        plan = self._state(context)
        return float(plan.start + plan.duration - context.get_time())

    def _calc_path(self, context: Context) -> Array:
        plan = self._state(context)
        if not plan.exists:
            return _NO_PATH
        q, screw_W = self._joint.Eval(context)[6], np.asarray(self._screw.Eval(context))
        steps = np.linspace(0.0, q, 25)
        return np.array([se3.exp(-screw_W * step) @ plan.motion.X_WE for step in steps])
