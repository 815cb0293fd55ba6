"""Whether the hand still holds what it closed around, from its pressures and the load on it.

The chambers are sealed around the bar. As long as it stays where it is the fingers keep their
posture, and the pressures with it, but for what the load bends; a finger that loses the bar curls
on, and so does one in which the bar shifts, as when the hand pushes a lid past which it has curled;
a chamber that leaks goes flat. And a hand that moves on without any load holds nothing, or
something without friction.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.port_values import (
    NO_SLIP,
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    HandLoad,
    SlipBelief,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class SlipDetectionConfig(Ticked):
    # Change of a chamber's pressure while the bar stays where it is, a share of it, 1 sigma.
    pressure_deviation: float = number(0.03, at_least=1e-6, at_most=10.0)
    # The same by the load.
    pressure_by_force: float = number(2.0e-3, at_least=0.0, at_most=1.0, unit="1/N")
    # Range in which the pressure is anywhere once the bar has moved, a share of it.
    pressure_range: float = number(1.7, above=0.0, at_most=100.0)
    # Share of the bodies whose bar shifts in the fingers and that are held or pushed nevertheless.
    shifting: float = number(0.03, above=0.0, below=1.0)
    # Fall of a sealed chamber's pressure beyond that of a fist, a share of it: it has lost air.
    fist: float = number(0.6, above=0.0, below=1.0)
    # Displacement of the bar in the fingers per change of the pressure, a share of it.
    shift_by_pressure: float = number(0.15, at_least=0.0, at_most=10.0, unit="m")
    # Force up to which it is known how the load bends the hand.
    known_force: float = number(30.0, at_least=0.0, at_most=1e4, unit="N")
    # Displacement of the bar in the fingers per force beyond that.
    shift_by_force: float = number(2.0e-4, at_least=0.0, at_most=1.0, unit="m/N")
    # Gauge pressure below which the hand is open.
    open_pressure: float = number(5.0e3, at_least=0.0, at_most=1e6, unit="Pa")
    # Force on a hand that holds nothing, each component: the model of its weight is wrong.
    empty_force: float = number(0.3, at_least=1e-6, at_most=1e3, unit="N")
    # Force on a hand that moves a body, each component, 1 sigma.
    held_force: float = number(5.0, at_least=1e-6, at_most=1e4, unit="N")
    # Share of the bodies that move without any force.
    frictionless: float = number(0.01, above=0.0, below=1.0)
    # Displacement of the hand over which the force is averaged.
    displacement: float = number(0.02, above=0.0, at_most=10.0, unit="m")
    # Largest log odds by pressures or by load, so that other senses can contradict them.
    limit: float = number(10.0, above=0.0, at_most=1e4, unit="nat")


@dataclass(frozen=True, kw_only=True)
class SlipState(Immutable):
    """What slip detection remembers.

    Attributes:
        free_force: Mean force (3,) on the open hand, the sensor's bias, [N].
        free_ticks: Of that mean.
        reference: Load when the hand had closed, None while it has not.
        p_WE: Where it was then (3,), [m].
        displacement: How far it has gone from there, [m].
        force: Average (3,) over the displacement of the force on the hand, [N].
        belief: The port value.
    """

    free_force: Array = field(default_factory=lambda: np.zeros(3))
    free_ticks: int = 0
    reference: HandLoad | None = None
    p_WE: Array = field(default_factory=lambda: np.zeros(3))
    displacement: float = 0.0
    force: Array = field(default_factory=lambda: np.zeros(3))
    belief: SlipBelief = NO_SLIP


def log_gaussian(squared_distance: float, sigma: float, size: int) -> float:
    """Log density of a vector of that length, each component with `sigma`."""
    return -0.5 * squared_distance / sigma**2 - size * float(np.log(np.sqrt(2.0 * np.pi) * sigma))


def pressure_change(load: HandLoad, reference: HandLoad, config: SlipDetectionConfig) -> Array:
    """Change of the chambers' pressures (chambers,), as shares; of chambers that hold some."""
    inflated = reference.pressures > config.open_pressure
    return np.asarray(load.pressures[inflated] / reference.pressures[inflated] - 1.0)


def force_change(load: HandLoad, reference: HandLoad) -> float:
    """By how much the force on the hand has changed, [N]."""
    return float(np.linalg.norm(load.F_S[3:] - reference.F_S[3:]))


def usual_change(load: HandLoad, reference: HandLoad, config: SlipDetectionConfig) -> float:
    """Change of the pressures, as a share, while the bar stays where it is, 1 sigma."""
    by_force = config.pressure_by_force * force_change(load, reference)
    return float(np.hypot(config.pressure_deviation, by_force))


def possible_shift(load: HandLoad, reference: HandLoad, config: SlipDetectionConfig) -> float:
    """How far the bar may have moved in the fingers, 1 sigma, [m]."""
    change = np.abs(pressure_change(load, reference, config)).max(initial=0.0)
    beyond = max(0.0, float(change) - usual_change(load, reference, config))
    excess = max(0.0, force_change(load, reference) - config.known_force)
    return float(np.hypot(config.shift_by_pressure * beyond, config.shift_by_force * excess))


def pressure_odds(load: HandLoad, reference: HandLoad, config: SlipDetectionConfig) -> float:
    """Log odds, given the pressures, that the bar is held no more.

    A held bar stays in its place or, rarely, shifts in the fingers; the pressures of a bar that has
    left its place, held or lost, may be anything that a sealed chamber can have.
    """
    change = pressure_change(load, reference, config)
    sigma = usual_change(load, reference, config)
    moved = -len(change) * float(np.log(config.pressure_range))
    held = np.log1p(-config.shifting) + log_gaussian(float(change @ change), sigma, len(change))
    if np.min(change, initial=0.0) > -config.fist:
        held = np.logaddexp(held, np.log(config.shifting) + moved)
    return float(moved - held)


def force_odds(force: Array, config: SlipDetectionConfig) -> float:
    """Log odds, given the force (3,) on the moving hand, that it moves nothing."""
    squared = float(force @ force)
    empty = log_gaussian(squared, config.empty_force, 3)
    loaded = log_gaussian(squared, float(np.hypot(config.held_force, config.empty_force)), 3)
    held = np.logaddexp(
        np.log1p(-config.frictionless) + loaded, np.log(config.frictionless) + empty
    )
    return float(empty - held)


def watch_open_hand(state: SlipState, load: HandLoad, config: SlipDetectionConfig) -> SlipState:
    """A tick before the hand has closed: learns the force that it measures while it is open."""
    forgotten = SlipState(free_force=state.free_force, free_ticks=state.free_ticks)
    if not np.all(load.pressures < config.open_pressure):
        return forgotten
    count = state.free_ticks + 1
    mean = state.free_force + (load.F_S[3:] - state.free_force) / count
    return replace(forgotten, free_force=mean, free_ticks=count)


def watch_closed_hand(
    state: SlipState, load: HandLoad, p_WE: Array, config: SlipDetectionConfig
) -> SlipState:
    """A tick at which the hand is closed: what its pressures and the load say."""
    reference = state.reference
    if not (np.isfinite(load.pressures).all() and np.isfinite(load.F_S).all()):
        return state
    if reference is None:
        force = load.F_S[3:] - state.free_force
        return replace(state, reference=load, p_WE=p_WE, force=force)
    displacement = max(state.displacement, float(np.linalg.norm(p_WE - state.p_WE)))
    share = 1.0 - np.exp(-(displacement - state.displacement) / config.displacement)
    force = state.force + share * (load.F_S[3:] - state.free_force - state.force)
    slipped = pressure_odds(load, reference, config)
    empty = (
        force_odds(force, config)
        if state.free_ticks and displacement > config.displacement
        else 0.0
    )
    belief = SlipBelief(
        log_odds=float(np.clip([slipped, empty], 0.0, config.limit).sum()),
        shift=max(possible_shift(load, reference, config), state.belief.shift),
    )
    return replace(state, displacement=displacement, force=force, belief=belief)


class SlipDetection(RecursiveFilter):
    """Recursive evidence that the hand has lost, or is losing, what it closed around.

    Three hypotheses explain the chambers' pressures: the bar stays where it is, and they change as
    little as the load and the fingers' creep make them; it has shifted and is still moved by the
    hand, and they may be anything but flat; or it is lost, and they may be anything.
    Two explain the force on a hand that moves: it moves a body, or nothing, and then the force is
    what it was while the hand was open. Neither is evidence of a grasp: a hand may close on nothing
    and keep its pressures, and be loaded by what it pushes.

    Input ports:
    - `hand_load_estimated`: `HandLoad`.
    - `end_effector_estimated`: `EndEffectorBelief` X_WE.
    - `interaction_active`: (1,) above 0.5 from the instant at which the hand has closed.

    Output ports:
    - `slip_estimated`: `SlipBelief`, of this tick.
    - `slip_latest`: `SlipBelief` of the last tick, from the state alone.

    Source: our own.
    """

    def __init__(self, config: SlipDetectionConfig) -> None:
        super().__init__()
        check(config, "SlipDetection")
        self._config = config
        self._load = self._declare_value_input("hand_load_estimated", UNKNOWN_LOAD)
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._declare_recursion(SlipState(), self._watch, config.period)
        self._declare_estimated("slip_estimated", lambda state: state.belief)
        self._declare_latest("slip_latest", lambda state: state.belief)

    def _watch(self, context: Context, state: Any) -> SlipState:
        load = self._read(self._load, context)
        if self._read(self._active, context)[0] <= 0.5:
            return watch_open_hand(state, load, self._config)
        p_WE = self._read(self._end_effector, context).X[:3, 3]
        return watch_closed_hand(state, load, p_WE, self._config)
