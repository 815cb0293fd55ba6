"""Friction, end stops and detents of a joint, from the hand's force on it and its configuration.

By virtual work, a spatial force F of the hand does the work tau = S · F per unit of q, with the
joint's unit twist S. While the joint moves,

    tau = tau_c sign(q') + b q' + e + s sign(q') exp(-|q'| / v_s) + noise,

where e is what does not depend on the motion: the joint's own weight, and the zero of the sensor.
Friction is another one while the joint moves slowly, greater (Stribeck) or less, by an unknown s.
An arm that pulls in one direction only cannot tell e from tau_c, so the prior of e limits how well
tau_c is known. Inertia and what changes during the motion count as noise, which is correlated.
Where the joint rests, the push is compared with what friction can hold. The filters work without
Drake:

    filters = JointMechanicsFilters(JointMechanicsConfig())
    state = filters.start()
    for joint, force in measurements:
        state = filters.update(state, joint, force)
    mechanics = filters.belief(state)

Frames: P parent, B child, E the hand.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check
from crossmodal.maths.vectors import cross
from crossmodal.systems.kinematics.joint_screws import (
    HandForce,
    hand_screw_covariance,
    screw_belief,
    speed_at,
)
from crossmodal.systems.kinematics.mechanics.force_regression import (
    ForceFit,
    ForceMoments,
    fit_force,
    no_moments,
    observe,
    rms_force,
)
from crossmodal.systems.kinematics.mechanics.joint_mechanics_config import JointMechanicsConfig
from crossmodal.systems.kinematics.mechanics.joint_stops import (
    Excess,
    Rest,
    begin_rest,
    continue_rest,
    detent_belief,
    left,
    limit_belief,
    pushed_on,
    remember,
)
from crossmodal.systems.port_values import (
    HELD_BODY,
    MOVING_TYPES,
    STATIC_BODY,
    JointBelief,
    JointMechanics,
    JointMechanicsBelief,
    JointModelBelief,
    JointType,
    LimitBelief,
)

GRAVITY = 9.81  # [m/s^2]
_PHI = 4  # sign(q'), q', 1, sign(q') exp(-|q'| / v_s).
NO_FORCES = no_moments(_PHI + 6)
_NOISES = np.geomspace(0.01, 20.0, 12)  # [N] at the hand.


@dataclass(frozen=True, kw_only=True)
class TypeState(Immutable):
    """What is known if the joint is of one type; an axis that turns over is still the same.

    Attributes:
        S: Unit twist (6,) at the last tick.
        S_covariance: (6, 6).
        flipped: -1.0 where the model's axis is opposite now.
        explored: By direction: how far it went, and the variance of that.
        moments: Of the samples at which it moved.
        passing: The latest samples (n,) of the motion that goes on.
        hand: The latest measurement; None before the first.
        push: Its force (6,), averaged over `smoothing`; None where there was none at the last tick.
        rest: The present one; None while it moves.
        rests: The earlier ones.
        is_left: Whether the last of these was just left and the push still grows.
    """

    S: Array
    S_covariance: Array
    flipped: float
    explored: dict[int, tuple[float, float]]
    moments: ForceMoments = NO_FORCES
    passing: tuple[Array, ...] = ()
    hand: HandForce | None = None
    push: Array | None = None
    rest: Rest | None = None
    rests: tuple[Rest, ...] = ()
    is_left: bool = False


@dataclass(frozen=True, kw_only=True)
class JointMechanicsState(Immutable):
    """What is known of one joint, by type.

    Attributes:
        parent_id: See `JointBelief`.
        child_id: See `JointBelief`.
        updates: Of the joint's belief; fewer than before mean that it was begun anew.
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
        self._settling = round(3.0 * config.smoothing / config.period)  # Ticks.

    def start(self) -> JointMechanicsState:
        """The state before any force was measured."""
        return JointMechanicsState(parent_id=STATIC_BODY, child_id=HELD_BODY, updates=0, types={})

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
            if joint_type in MOVING_TYPES
        }
        return JointMechanicsState(
            parent_id=joint.parent_id, child_id=joint.child_id, updates=joint.updates, types=types
        )

    def _update_type(
        self,
        state: TypeState | None,
        joint_type: JointType,
        model: JointModelBelief,
        force: HandForce | None,
    ) -> TypeState:
        S, covariance = screw_belief(joint_type, model)
        flipped = 1.0 if state is None or _same_side(S, state.S) else -1.0
        S = flipped * S
        q, v = (float(x) for x in flipped * model.configuration)
        q_variance, v_variance = (float(x) for x in np.diag(model.configuration_covariance))
        if state is None:
            explored = {-1: (q, q_variance), 1: (q, q_variance)}
            state = TypeState(S=S, S_covariance=covariance, flipped=flipped, explored=explored)
        else:
            explored = _explore(state.explored, q, q_variance)
            state = replace(state, S=S, S_covariance=covariance, flipped=flipped, explored=explored)
        if force is None:
            return replace(_interrupted(state), push=None)
        # A force that was sensed while the joint moved is no push of a rest.
        last = force.F_P if state.push is None or state.rest is None else state.push
        push = last + self._share * (force.F_P - last)
        state = replace(state, hand=force, push=push)
        speed = abs(v) * speed_at(S, force.X_PE[:3, 3])
        slow = speed <= self.config.least_speed
        if state.rest is not None and (slow or not left(state.rest, q, q_variance)):
            rest = continue_rest(state.rest, force.F_P, push)
            if slow and q_variance < rest.variance:
                rest = replace(rest, q=q, variance=q_variance)
            return _interrupted(replace(state, rest=rest))
        if state.rest is not None:
            rest = replace(state.rest, release=1 if q > state.rest.q else -1)
            state = replace(state, rest=None, rests=remember(state.rests, rest), is_left=True)
        elif state.is_left:
            pushed = pushed_on(state.rests[-1], force.F_P, S)
            rests = state.rests if pushed is None else (*state.rests[:-1], pushed)
            state = replace(state, rests=rests, is_left=pushed is not None)
        if not slow and abs(v) > 3.0 * np.sqrt(v_variance):
            side, slowly = np.sign(v), np.exp(-speed / self.config.slow)
            return self._moves(state, np.array([side, v, 1.0, side * slowly, *force.F_P]))
        if slow:
            rest = begin_rest(q, q_variance, force.F_P, push)
            state = replace(state, rest=rest, is_left=False)
        return _interrupted(state)

    def _moves(self, state: TypeState, z: Array) -> TypeState:
        """A sample counts where the joint moved for a while before and after it.

        Around a start or a stop the rate is believed late, and inertia is part of the force.
        """
        passing = (*state.passing, z)[-2 * self._settling - 1 :]
        if len(passing) <= 2 * self._settling:
            return replace(state, passing=passing)
        moments = observe(state.moments, passing[self._settling])
        return replace(state, passing=passing, moments=moments)

    def belief(self, state: JointMechanicsState) -> JointMechanics:
        """What is believed of the joint's mechanics."""
        return JointMechanics(
            parent_id=state.parent_id,
            child_id=state.child_id,
            models={
                joint_type: self._read(known)
                for joint_type, known in state.types.items()
                if known.hand is not None
            },
        )

    def _read(self, state: TypeState) -> JointMechanicsBelief:
        hand = state.hand
        assert hand is not None
        lever = max(speed_at(state.S, hand.X_PE[:3, 3]), 1e-3)
        prior, elsewhere = self._prior(state, hand, lever)
        noises = lever * _NOISES
        fit = fit_force(state.moments, state.S, prior, noises, self.config.unevenness)
        screw = state.S_covariance + hand_screw_covariance(state.S, hand)
        rests = [*state.rests, *([state.rest] if state.rest is not None else [])]
        slack = self.config.slack / lever

        def judge(rest: Rest, direction: int) -> Excess:
            return self._judge(
                fit, state.S, screw, direction, rest.push(state.S, direction), elsewhere
            )

        lower, upper = (
            limit_belief(direction, rests, state.explored[direction], slack, judge)
            for direction in (-1, 1)
        )
        detent = detent_belief(rests, judge)
        if state.flipped < 0.0:
            lower, upper = _mirrored(upper), _mirrored(lower)
            detent = replace(detent, position=-detent.position)
        samples = state.moments.samples
        path = float(state.moments.first[0, 1] + state.moments.now[0, 1])
        measured = state.push is not None
        return JointMechanicsBelief(
            friction=fit.theta[:2],
            friction_covariance=fit.covariance(screw)[:2, :2],
            noise=fit.noise,
            samples=samples,
            mean_speed=path / samples if samples else float("nan"),
            lower=lower,
            upper=upper,
            detent=detent,
            force=state.flipped * float(state.S @ hand.F_P) if measured else float("nan"),
        )

    def _prior(self, state: TypeState, hand: HandForce, lever: float) -> tuple[Array, float]:
        """Standard deviations: (_PHI,), and of a weight's moment at a rest against elsewhere.

        Per unit of q, a mass at c falls by (v + omega x c) · down; the axis may be off, too. A lid
        is heavy while it lies and light once it stands.
        """
        config, S = self.config, state.S
        weight = config.mass * GRAVITY
        to_down = np.concatenate([cross(hand.X_PE[:3, 3], hand.down_P), hand.down_P])
        falls = float((S @ to_down) ** 2 + to_down @ state.S_covariance @ to_down)
        aside = float(np.linalg.norm(cross(S[:3], hand.down_P))) * (lever + config.extent)
        own = weight**2 * (falls + aside**2) + float(S @ hand.zero_covariance @ S)
        friction = config.friction * lever
        slowly = min(friction, rms_force(state.moments, S)) if state.moments.samples else friction
        prior = np.array([friction, config.damping * lever**2, np.sqrt(own + 1e-9), slowly])
        return prior, weight * aside * (state.explored[1][0] - state.explored[-1][0])

    def _judge(
        self, fit: ForceFit, S: Array, screw: Array, direction: int, F: Array, elsewhere: float
    ) -> Excess:
        """Whether a resting joint's friction can hold the push of F in a direction."""
        c = np.array([1.0, 0.0, direction, 0.0])
        held = c + np.array([self.config.stiction, 0.0, 0.0, 0.0])

        def variance(c: Array) -> float:
            by_screw = direction * F - fit.by_screw.T @ c
            of_fit = c @ fit.spread @ c + by_screw @ screw @ by_screw
            return float(of_fit + fit.noise**2 + elsewhere**2)

        push, sigma = direction * float(S @ F), float(np.sqrt(variance(held)))
        over, under = push - held @ fit.theta, -push - held @ fit.theta
        probability = float(ndtr(over / sigma) - ndtr(under / sigma))
        return Excess(
            force=push - float(c @ fit.theta),
            variance=variance(c),
            probability=max(probability, 0.0),
        )


def _same_side(S: Array, before: Array) -> bool:
    """Whether a twist points as an earlier one does, by its axis."""
    part = slice(0, 3) if float(np.linalg.norm(S[:3])) > 0.5 else slice(3, 6)
    return float(S[part] @ before[part]) >= 0.0


def _explore(
    explored: dict[int, tuple[float, float]], q: float, variance: float
) -> dict[int, tuple[float, float]]:
    """The farthest that is sure to have been reached, in either direction."""
    farther = dict(explored)
    for direction, (most, most_variance) in explored.items():
        if direction * q - np.sqrt(variance) > direction * most - np.sqrt(most_variance):
            farther[direction] = (q, variance)
    return farther


def _interrupted(state: TypeState) -> TypeState:
    return replace(state, moments=replace(state.moments, last=None), passing=())


def _mirrored(limit: LimitBelief) -> LimitBelief:
    return replace(limit, position=-limit.position, bound=-limit.bound)
