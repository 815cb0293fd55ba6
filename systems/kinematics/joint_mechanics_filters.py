"""Friction, end stops and latches of a joint, from the hand's force on it and its configuration.

By virtual work, a spatial force F of the hand does the work tau = S · F per unit of q, with the
joint's unit twist S. While the joint moves,

    tau = tau_c sign(q') + b q' + e_0 + e_1 sin(q) + e_2 (1 - cos(q)) + noise,

where gravity and springs are unknown, and an arm that pulls one way only cannot tell e_0 from
tau_c: the prior of e says how far that goes (for a slide, e_1 q). Inertia counts as noise, which
has a memory. Where it rests, the push is compared with what friction can hold. The filters work
without Drake:

    filters = JointMechanicsFilters(JointMechanicsConfig())
    state = filters.start()
    for joint, force in measurements:
        state = filters.update(state, joint, force)
    mechanics = filters.belief(state)

Frames: P parent, B child, E the hand.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from maths.arrays import Array
from maths.immutable import Immutable
from maths.validation import check, number
from systems.kinematics.force_regression import (
    ForceFit,
    ForceMoments,
    fit_force,
    no_moments,
    observe,
)
from systems.kinematics.joint_screws import SCREWS, screw_belief, speed_at
from systems.kinematics.joint_stops import (
    NO_LATCH,
    Rest,
    begin_rest,
    continue_rest,
    latch_odds,
    limit_belief,
    remember,
    stop_odds,
)
from systems.port_values import (
    JointBelief,
    JointMechanics,
    JointMechanicsBelief,
    JointModelBelief,
    JointType,
    LatchBelief,
    LimitBelief,
)
from systems.ticks import tick_period

GRAVITY = 9.81  # [m/s^2]
ERRORS = 12  # Constant errors of a measured force: of the hand's pose, and of the force itself.
_PHI = 5  # sign(q'), q', and three of the position's own force.
_SIZE = _PHI + 6 + ERRORS
_RECENT = 15  # Samples among which the push that set the joint moving is looked for.


@dataclass(kw_only=True)
class JointMechanicsConfig:
    """Priors; forces are those at the hand, which a hinge's lever turns into torques.

    Attributes:
        period: Of the ticks.
        friction: Prior standard deviation of Coulomb friction.
        damping: The same of the viscous coefficient.
        mass: Of what moves, against gravity.
        extent: How far its centre may be from the hand, across gravity.
        spring: Stiffness that depends on the position.
        zero_force: Of a force sensor that was never read while the hand was free.
        zero_torque: The same of its torque.
        stiction: By how much static friction exceeds Coulomb friction, as a share, on average.
        push: Of the arm against an end stop, on average.
        latch: Force of a latch, on average.
        stop_prior: Probability that a joint that rests at its extreme does so at a stop.
        latch_prior: That one is released from a latch when it starts to move.
        least_speed: Of the hand; a slower joint rests.
        slack: Way at the hand that a joint may go on at an end stop.
        largest_axis_angle: Standard deviation of an axis about which forces are not looked at.
        settle: For so long a joint moves before and after an instant that counts.
        smoothing: Time over which a push has to last.
        open_pressure: Gauge pressure of a chamber, below which the hand is open.
        largest_failure: Probability of a lost grasp above which the force is not the joint's.
    """

    period: float = tick_period()
    friction: float = number(20.0, above=0.0, at_most=1e4, unit="N")
    damping: float = number(30.0, above=0.0, at_most=1e5, unit="N s/m")
    mass: float = number(5.0, at_least=0.0, at_most=1e3, unit="kg")
    extent: float = number(0.2, at_least=0.0, at_most=10.0, unit="m")
    spring: float = number(2.0, at_least=0.0, at_most=1e5, unit="N/m")
    zero_force: float = number(1.0, above=0.0, at_most=100.0, unit="N")
    zero_torque: float = number(0.1, above=0.0, at_most=100.0, unit="N m")
    stiction: float = number(0.1, above=0.0, at_most=10.0)
    push: float = number(20.0, above=0.0, at_most=1e4, unit="N")
    latch: float = number(10.0, above=0.0, at_most=1e4, unit="N")
    stop_prior: float = number(0.2, above=0.0, below=1.0)
    latch_prior: float = number(0.1, above=0.0, below=1.0)
    least_speed: float = number(0.005, above=0.0, at_most=10.0, unit="m/s")
    slack: float = number(0.002, at_least=0.0, at_most=1.0, unit="m")
    largest_axis_angle: float = number(0.3, above=0.0, at_most=10.0, unit="rad")
    settle: float = number(0.6, at_least=0.0, at_most=10.0, unit="s")
    smoothing: float = number(0.2, above=0.0, at_most=10.0, unit="s")
    open_pressure: float = number(5.0e3, at_least=0.0, at_most=1e6, unit="Pa")
    largest_failure: float = number(0.5, above=0.0, at_most=1.0)


@dataclass(frozen=True, kw_only=True)
class HandForce(Immutable):
    """What the hand does to the body that it holds.

    Attributes:
        F_P: Spatial force (6,) on the body at Po, torque [N m] first, expressed in P.
        p_PE: Where the hand is (3,), [m].
        errors: (6, ERRORS) change of F_P by one standard deviation of each constant error.
        down_P: Unit vector (3,) of gravity in P.
    """

    F_P: Array
    p_PE: Array
    errors: Array = field(default_factory=lambda: np.zeros((6, ERRORS)))
    down_P: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))


@dataclass(frozen=True, kw_only=True)
class TypeState(Immutable):
    """What is known if the joint is of one type; its S points as at the first tick.

    Attributes:
        S: Unit twist (6,) at the last tick.
        S_covariance: (6, 6).
        flipped: -1.0 where the model's axis is opposite now.
        lever: Of the hand, [1] or [m].
        prior: Standard deviations of theta (_PHI,).
        moments: Of the samples at which it moved.
        passing: The latest samples (n,) of the motion that goes on.
        smooth: Sample z (n,), averaged over `smoothing`; None before the first.
        recent: The latest of these.
        rest: The present one; None while it moves.
        rests: The earlier ones.
        explored: By direction: how far it went, and the variance of that.
        tau: At the last tick, NaN where it was not measured.
    """

    S: Array
    S_covariance: Array
    flipped: float
    lever: float
    prior: Array
    moments: ForceMoments
    passing: tuple[Array, ...]
    smooth: Array | None
    recent: tuple[Array, ...]
    rest: Rest | None
    rests: tuple[Rest, ...]
    explored: dict[int, tuple[float, float]]
    tau: float


@dataclass(frozen=True, kw_only=True)
class JointMechanicsState(Immutable):
    """What is known of one joint, by type.

    Attributes:
        parent_id: See `JointBelief`.
        child_id: See `JointBelief`.
        updates: Of the joint's belief; fewer than before say that it was begun anew.
        types: By type that moves.
    """

    parent_id: int
    child_id: int
    updates: int
    types: dict[JointType, TypeState]


class JointMechanicsFilters:
    """Updates and reads the mechanics of any number of joints; see the module."""

    def __init__(self, config: JointMechanicsConfig, owner: str = "JointMechanicsFilters") -> None:
        check(config, owner)
        self.config = config
        self._share = 1.0 - float(np.exp(-config.period / config.smoothing))

    def start(self, parent_id: int = 0, child_id: int = 1) -> JointMechanicsState:
        return JointMechanicsState(parent_id=parent_id, child_id=child_id, updates=0, types={})

    def update(
        self, state: JointMechanicsState, joint: JointBelief, force: HandForce | None
    ) -> JointMechanicsState:
        """The state after one tick.

        Args:
            state: The last one; not changed.
            joint: Its belief at this tick.
            force: None where it was not measured or the hand does not hold the body.
        """
        known = state.types if joint.updates >= state.updates else {}
        types = {
            joint_type: self._update_type(known.get(joint_type), joint_type, model, force)
            for joint_type, model in joint.models.items()
            if joint_type in SCREWS
        }
        return JointMechanicsState(
            parent_id=joint.parent_id,
            child_id=joint.child_id,
            updates=joint.updates,
            types=types,
        )

    def _update_type(
        self,
        state: TypeState | None,
        joint_type: JointType,
        model: JointModelBelief,
        force: HandForce | None,
    ) -> TypeState:
        config = self.config
        S, S_covariance = screw_belief(joint_type, model)
        q, v = (float(x) for x in model.configuration)
        q_variance, v_variance = np.diag(model.configuration_covariance)
        flipped = 1.0
        if state is None:
            state = TypeState(
                S=S,
                S_covariance=S_covariance,
                flipped=1.0,
                lever=1.0,
                prior=np.ones(_PHI),
                moments=no_moments(_SIZE),
                passing=(),
                smooth=None,
                recent=(),
                rest=None,
                rests=(),
                explored={-1: (q, q_variance), 1: (q, q_variance)},
                tau=float("nan"),
            )
        elif _opposite(S, state.S):
            S, q, v, flipped = -S, -q, -v, -1.0
        state = replace(state, S=S, S_covariance=S_covariance, flipped=flipped)
        state = _explore(state, q, float(q_variance))
        if force is None:
            return replace(_interrupted(state), smooth=None, recent=(), tau=float("nan"))
        lever = max(speed_at(S, force.p_PE), 1e-3)
        turns = float(np.linalg.norm(S[:3])) > 0.5
        own = [1.0, np.sin(q), 1.0 - np.cos(q)] if turns else [1.0, q, 0.0]
        state = replace(state, lever=lever, prior=self._prior(S, lever, force))
        certain = abs(v) > 3.0 * np.sqrt(v_variance)
        moving = abs(v) * lever > config.least_speed and certain
        z = np.concatenate([[np.sign(v), v], own, force.F_P, S @ force.errors])
        tau = float(S @ force.F_P)
        smooth = z if state.smooth is None else state.smooth + self._share * (z - state.smooth)
        state = replace(state, smooth=smooth, tau=tau, recent=(*state.recent, smooth)[-_RECENT:])
        if moving:
            state = _set_moving(state, int(np.sign(v)))
            if np.trace(model.axis_covariance) <= config.largest_axis_angle**2:
                return self._count(state, z)
        elif abs(v) * lever <= config.least_speed:
            pushed = float(S @ smooth[_PHI : _PHI + 6])
            rest = state.rest
            if rest is None:
                rest = begin_rest(q, float(q_variance), smooth, pushed)
            else:
                rest = continue_rest(rest, q, float(q_variance), smooth, pushed)
            state = replace(state, rest=rest)
        return _interrupted(state)

    def _count(self, state: TypeState, z: Array) -> TypeState:
        """A sample counts where the joint moved for a while before and after it.

        Around a start or a stop the rate is believed late, and inertia is part of the force.
        """
        settle = round(self.config.settle / self.config.period)
        passing = (*state.passing, z)[-2 * settle - 1 :]
        if len(passing) <= 2 * settle:
            return replace(state, passing=passing)
        return replace(state, passing=passing, moments=observe(state.moments, passing[settle]))

    def _prior(self, S: Array, lever: float, force: HandForce) -> Array:
        """Standard deviations (_PHI,); how the joint moves against gravity says what of e there is.

        Per unit of q, a mass at c falls by (v + omega x c) · down.
        """
        c, weight = self.config, self.config.mass * GRAVITY
        falls = float((S[3:] + np.cross(S[:3], force.p_PE)) @ force.down_P)
        aslant = float(np.linalg.norm(np.cross(S[:3], force.down_P)))
        swing = weight * aslant * (lever + c.extent)
        constant = weight * np.hypot(falls, aslant * c.extent)
        spring = c.spring * lever**2
        return np.array(
            [
                c.friction * lever,
                c.damping * lever**2,
                constant,
                np.hypot(spring, swing),
                swing,
            ]
        )

    def belief(self, state: JointMechanicsState) -> JointMechanics:
        """What is believed of the joint's mechanics."""
        return JointMechanics(
            parent_id=state.parent_id,
            child_id=state.child_id,
            models={joint_type: self._read(known) for joint_type, known in state.types.items()},
        )

    def _read(self, state: TypeState) -> JointMechanicsBelief:
        noises = state.lever * np.geomspace(0.01, 20.0, 12)
        fit = fit_force(state.moments, state.S, state.S_covariance, state.prior, noises)
        limits = {way: self._limit(state, fit, way) for way in (-1, 1)}
        latch = self._latch(state, fit)
        lower, upper = limits[-1], limits[1]
        if state.flipped < 0.0:
            lower, upper = _mirrored(upper), _mirrored(lower)
            latch = replace(latch, position=-latch.position)
        samples = state.moments.samples
        way = float(state.moments.first[0, 1] + state.moments.now[0, 1])
        return JointMechanicsBelief(
            friction=fit.theta[:2],
            friction_covariance=fit.covariance[:2, :2],
            noise=fit.noise,
            samples=samples,
            mean_speed=way / samples if samples else float("nan"),
            lower=lower,
            upper=upper,
            latch=latch,
            force=state.flipped * state.tau,
        )

    def _excess(
        self, state: TypeState, fit: ForceFit, z: Array, way: int
    ) -> tuple[float, float, float]:
        """Push that way beyond the position's own force, beyond friction too, and its sigma."""
        own = np.concatenate([[0.0, 0.0], z[2:_PHI]])
        against = own + way * np.eye(_PHI)[0]
        F = z[_PHI : _PHI + 6]
        tau = float(state.S @ F)
        variance = against @ fit.covariance @ against + F @ state.S_covariance @ F
        variance += fit.noise**2 + float(z[_PHI + 6 :] @ z[_PHI + 6 :])
        push = way * (tau - float(own @ fit.theta))
        return push, push - float(fit.theta[0]), float(np.sqrt(variance))

    def _friction(self, fit: ForceFit, lever: float) -> float:
        """Coulomb friction as large as it may well be, [N or N m]."""
        mean, variance = max(float(fit.theta[0]), 0.0), float(fit.covariance[0, 0])
        return max(float(np.hypot(mean, np.sqrt(variance))), 1e-2 * lever)

    def _limit(self, state: TypeState, fit: ForceFit, way: int) -> LimitBelief:
        c, lever = self.config, state.lever
        rests = [*state.rests] + ([state.rest] if state.rest is not None else [])
        odds = []
        for rest in rests:
            push, _, sigma = self._excess(state, fit, rest.push[way], way)
            friction = self._friction(fit, lever)
            odds.append((rest, stop_odds(push, friction, c.stiction, c.push * lever, sigma)))
        return limit_belief(way, odds, state.explored[way], c.stop_prior, c.slack / lever)

    def _latch(self, state: TypeState, fit: ForceFit) -> LatchBelief:
        c, best = self.config, NO_LATCH
        for rest in state.rests:
            if rest.peak is None:
                continue
            _, excess, sigma = self._excess(state, fit, rest.peak, rest.release)
            friction = self._friction(fit, state.lever)
            odds = latch_odds(excess, friction, c.stiction, c.latch * state.lever, sigma)
            log_odds = odds + np.log(c.latch_prior / (1.0 - c.latch_prior))
            probability = float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))
            if probability > best.probability:
                best = LatchBelief(
                    probability=probability,
                    position=rest.q,
                    variance=rest.variance,
                    force=excess,
                    force_variance=sigma**2,
                )
        return best


def _opposite(S: Array, before: Array) -> bool:
    """Whether a twist points against an earlier one, by its axis."""
    part = slice(0, 3) if float(np.linalg.norm(S[:3])) > 0.5 else slice(3, 6)
    return float(S[part] @ before[part]) < 0.0


def _explore(state: TypeState, q: float, variance: float) -> TypeState:
    """The farthest that is sure to have been reached, either way."""
    explored = dict(state.explored)
    for way, (most, most_variance) in state.explored.items():
        if way * q - np.sqrt(variance) > way * most - np.sqrt(most_variance):
            explored[way] = (q, variance)
    return replace(state, explored=explored)


def _interrupted(state: TypeState) -> TypeState:
    return replace(state, moments=replace(state.moments, last=None), passing=())


def _set_moving(state: TypeState, way: int) -> TypeState:
    if state.rest is None:
        return state
    pushes = [way * float(state.S @ z[_PHI : _PHI + 6]) for z in state.recent]
    rest = replace(state.rest, release=way, peak=state.recent[int(np.argmax(pushes))])
    return replace(state, rest=None, rests=remember(state.rests, rest))


def _mirrored(limit: LimitBelief) -> LimitBelief:
    return replace(limit, position=-limit.position, bound=-limit.bound)
