"""Touches something along a straight approach and stops at the first contact."""

from collections.abc import Iterator
from collections.abc import Sequence as Items
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import islice
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.joint_motion import JointMotion, resting
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.controllers.arm.sequence import read
from crossmodal.controllers.primitives.arm_task import (
    ArmTask,
    TransitConfig,
    believed_obstacles,
)
from crossmodal.controllers.primitives.taxel_tare import TaxelTare, no_tare, tare
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number

_LINES = 4  # Ways to make one touch to which a path is sought before it is given up.
_ROLLS = 6  # Turns of the gripper about the approach that are tried, over half a turn.


@dataclass(kw_only=True)
class GuardedTouchConfig:
    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Between decisions.
    speed: float = number(0.025, above=0.0, at_most=1.0, unit="m/s")  # Of the approach.
    # Of the force on a taxel beyond what it was before the approach.
    threshold: float = number(0.08, above=0.0, at_most=100.0, unit="N")
    # Decisions in a row at which a taxel must exceed it.
    confirmations: int = number(2, at_least=1, at_most=100)
    # For which the taxels' offsets are averaged before the way to a touch.
    tare_time: float = number(0.2, above=0.0, at_most=60.0, unit="s")
    # Least length of an approach that is worth making.
    shortest: float = number(0.02, at_least=0.0, at_most=1.0, unit="m")
    transit: TransitConfig = field(default_factory=lambda: TransitConfig(speed=0.075))


class TouchPhase(StrEnum):
    """What the touching arm does."""

    WAIT = ""
    TARE = "takes the taxels' offsets"
    TRANSIT = "moves to the next touch"
    APPROACH = "approaches"
    RETREAT = "retreats"
    HOME = "moves the gripper away"


class TouchOutcome(StrEnum):
    """How a touch ended."""

    NONE = ""
    CONTACT = "contact"
    MISS = "miss"
    UNREACHABLE = "unreachable"


@dataclass(frozen=True, kw_only=True)
class TouchEnd(Immutable):
    """How the last touch ended.

    Attributes:
        number: Of the touch; zero before the first one.
        outcome: `contact`, `miss` or `unreachable`.
        q_start: Measured posture (n,) at the begin of the approach, [rad].
        q_end: At the contact, or where the approach ended (n,), [rad].
        forces: On the taxels at the contact (T, 3), offsets taken out, [N].
    """

    number: int = 0
    outcome: TouchOutcome = TouchOutcome.NONE
    q_start: Array = field(default_factory=lambda: np.zeros(0))
    q_end: Array = field(default_factory=lambda: np.zeros(0))
    forces: Array = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, kw_only=True)
class TouchState(Immutable):
    """What is done, and how the arm moves.

    Attributes:
        phase: What it does.
        motion: Of the arm.
        number: Of the touch that it makes.
        since: When the phase began, [s].
        path: Postures on the way to the approach (K, n), [rad].
        line: Postures of the approach (K, n), [rad].
        readings: Of the taxels (K, 3 T) since the phase began, while their offsets are taken, [N].
        tare: Of the taxels.
        failure: Why it does not touch any more; empty while it does.
        stays: Whether no way home was found, so that it stays where it is.
        exceeded: Decisions in a row at which a taxel exceeded the threshold.
        q_start: Measured posture (n,) at the begin of the approach, [rad].
        end: How the last touch ended.
    """

    motion: JointMotion
    tare: TaxelTare
    phase: TouchPhase = TouchPhase.WAIT
    number: int = 0
    since: float = 0.0
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))
    line: Array = field(default_factory=lambda: np.zeros((0, 0)))
    readings: Array = field(default_factory=lambda: np.zeros((0, 0)))
    failure: str = ""
    stays: bool = False
    exceeded: int = 0
    q_start: Array = field(default_factory=lambda: np.zeros(0))
    end: TouchEnd = field(default_factory=TouchEnd)


class GuardedTouch(ArmTask):
    """Goes before each touch that is wanted, approaches until a taxel is pressed, and retreats.

    What presses a taxel on the way to a touch stops the arm, too, and is a contact.

    Input ports:
    - those of `ArmTask`.
    - `touch_latest`: with `number`, `start`, `direction`, `reach`, the box `box_edges`, `X_WB`
      that holds the object, what holds all others, `obstacles`, and `done`.
    - `taxel_measured`: (3 T,) forces on the taxels, [N].
    - `is_clear`: (1,) above 0.5 while the other arm is out of the way.
    - `approach_speed`: (1,) of the approaches that begin now, [m/s]; the configured one if not
      connected.
    - `contact_threshold`: (1,) of the force on a taxel, [N]; the configured one if not connected.

    Output ports:
    - `joint_position_commanded`: (n,), [rad].
    - `touch_end`: `TouchEnd` of the last touch.
    - `phase`: str.
    - `failure`: str, why it does not touch any more; empty while it does.
    - `is_done`: (1,) 1 when no touch is wanted any more, or none can be made, and the arm has come
      to rest.

    State: `TouchState`.

    Frames: W world, E end-effector: the closed fingers' end, z along them.

    Args:
        config: Of motions and contact.
        arm: The robot's own model.
        planner: Of this arm.
        q_home: Where it begins and ends (n,), [rad].
        others: Numbers of joints of other arms by the names of their models.
        taxels: Their number T.
        guards: Indices of those that meet first what the gripper approaches. If one of them says
            the same all the time, it does not touch any more.
    """

    def __init__(
        self,
        config: GuardedTouchConfig,
        arm: ArmModel,
        planner: MotionPlanner,
        q_home: Array,
        others: dict[str, int],
        taxels: int,
        guards: Ids,
    ) -> None:
        check(config, "GuardedTouch")
        super().__init__(arm, planner, config.transit, others)
        self._config, self._q_home, self._guards = config, q_home, guards
        self._touch = self.DeclareAbstractInputPort("touch_latest", Value[object]())
        self._taxels = self.DeclareVectorInputPort("taxel_measured", 3 * taxels)
        self._is_clear = self.DeclareVectorInputPort("is_clear", 1)
        self._speed = self.DeclareVectorInputPort("approach_speed", 1)
        self._threshold = self.DeclareVectorInputPort("contact_threshold", 1)
        first = TouchState(motion=resting(q_home), tare=no_tare(taxels))
        self._declare_state(first, config.period)
        self._declare_command()
        self._declare_value("touch_end", TouchEnd(), lambda c: self._state(c).end, self._on_state)
        self._declare_value("failure", "", lambda c: self._state(c).failure, self._on_state)
        self._declare_value("phase", "", lambda c: str(self._state(c).phase), self._on_state)
        self._declare_vector("is_done", 1, self._is_done)

    def _is_done(self, context: Context) -> float:
        state: TouchState = self._state(context)
        ended = self._touch.Eval(context).done or state.failure
        at_rest = context.get_time() >= state.motion.end
        at_home = np.array_equal(state.motion.knots[-1], self._q_home)
        return float(bool(ended) and at_rest and (at_home or state.stays))

    def _next(self, context: Context) -> TouchState:
        state: TouchState = self._state(context)
        time, config = context.get_time(), self._config
        threshold = float(read(self._threshold, context, config.threshold)[0])
        guarded = state.phase in (TouchPhase.TRANSIT, TouchPhase.APPROACH)
        if guarded:
            largest = np.linalg.norm(self._forces(context, state), axis=1).max()
            exceeded = state.exceeded + 1 if largest > threshold else 0
            if exceeded >= config.confirmations:
                return self._ended(context, state, TouchOutcome.CONTACT)
            if exceeded != state.exceeded:
                state = replace(state, exceeded=exceeded)
        if state.phase is TouchPhase.TARE:
            return self._tare(context, state)
        if time < state.motion.end + self._transit.rest_time * (state.phase is TouchPhase.TRANSIT):
            return state
        if state.phase is TouchPhase.APPROACH:
            return self._ended(context, state, TouchOutcome.MISS)
        if state.phase is TouchPhase.TRANSIT:
            return self._approach(context, state)
        return self._decide(context, state)

    def _decide(self, context: Context, state: TouchState) -> TouchState:
        """What follows where nothing is under way."""
        wanted = self._touch.Eval(context)
        here, others = state.motion.knots[-1], self._others_now(context)
        ended = wanted.done or bool(state.failure)
        if ended:
            waits = state.stays or np.array_equal(here, self._q_home)
        else:
            waits = wanted.number <= state.number or self._is_clear.Eval(context)[0] < 0.5
        if waits:
            return replace(state, phase=TouchPhase.WAIT) if state.phase else state
        self._planner.look_at(others, believed_obstacles(wanted))
        if len(state.path) and not self._planner.is_free(here):
            # What is believed now holds the object here, too: it goes back the way it came.
            back = self._motion(np.vstack([here, state.path[::-1]]), context)
            return replace(state, phase=TouchPhase.RETREAT, motion=back, path=state.path[:0])
        if ended:
            return self._home(context, state)
        state = replace(state, number=wanted.number)
        lines = touch_lines(self._planner, wanted, [here, self._q_home], others, self._config)
        line, path, rng = here[None], None, np.random.default_rng(wanted.number)
        for line in islice(lines, _LINES):
            self._planner.look_at(others, believed_obstacles(wanted))
            path = self._planner.path(here, line[0], rng)
            if path is not None:
                break
        if path is None:
            end = TouchEnd(number=wanted.number, outcome=TouchOutcome.UNREACHABLE)
            return replace(state, phase=TouchPhase.WAIT, end=end)
        return replace(
            state,
            phase=TouchPhase.TARE,
            since=context.get_time(),
            path=path,
            line=line,
            readings=np.array([self._taxels.Eval(context)]),
        )

    def _tare(self, context: Context, state: TouchState) -> TouchState:
        """Averages the taxels' readings at rest, then begins the way to the touch."""
        time = context.get_time()
        readings = np.vstack([state.readings, self._taxels.Eval(context)])
        if time < state.since + self._config.tare_time:
            return replace(state, readings=readings)
        # The first reading was taken as the arm came to rest.
        taken = tare(readings[1:])
        if not taken.works[self._guards].all():
            silent = ", ".join(str(n) for n in self._guards[~taken.works[self._guards]])
            why = f"taxels {silent} at the fingers' end always say the same: no touch is safe"
            return replace(state, phase=TouchPhase.WAIT, failure=why)
        return replace(
            state,
            phase=TouchPhase.TRANSIT,
            motion=self._motion(state.path, context),
            tare=taken,
            exceeded=0,
        )

    def _forces(self, context: Context, state: TouchState) -> Array:
        """Forces (T, 3) beyond the offsets, on taxels that work, [N]."""
        return state.tare.forces(np.asarray(self._taxels.Eval(context)))

    def _approach(self, context: Context, state: TouchState) -> TouchState:
        speed = float(read(self._speed, context, self._config.speed)[0])
        return replace(
            state,
            phase=TouchPhase.APPROACH,
            motion=self._line(state.line, speed, context),
            q_start=self._positions(context),
        )

    def _ended(self, context: Context, state: TouchState, outcome: TouchOutcome) -> TouchState:
        """Stops, keeps what was measured, and goes back where it came from."""
        time, q = context.get_time(), self._positions(context)
        approaching = state.phase is TouchPhase.APPROACH
        end = TouchEnd(
            number=state.number,
            outcome=outcome,
            q_start=state.q_start if approaching else q,
            q_end=q,
            forces=self._forces(context, state),
        )
        back = state.motion.back(time, q)
        # An approach is a straight line, and the way back must not leave it.
        retreat = self._line(back, self._transit.speed, context)
        return replace(
            state,
            phase=TouchPhase.RETREAT,
            motion=retreat if approaching else self._motion(back, context),
            end=end,
            exceeded=0,
        )

    def _home(self, context: Context, state: TouchState) -> TouchState:
        """Goes home around the object; the planner has just looked."""
        here = state.motion.knots[-1]
        path = self._planner.path(here, self._q_home, np.random.default_rng(0))
        if path is None:  # It stays where it is: no touch is wanted any more.
            return replace(state, phase=TouchPhase.WAIT, stays=True)
        return replace(state, phase=TouchPhase.HOME, motion=self._motion(path, context))


def touch_lines(
    planner: MotionPlanner,
    wanted: Any,
    guesses: Items[Array],
    others: dict[str, Array],
    config: GuardedTouchConfig,
) -> Iterator[Array]:
    """Postures (K, n) of a touch's approach, for each way in which the arm can make it.

    The gripper may be turned about the approach in any way; what stands where the object is thought
    to be is no obstacle.

    Args:
        planner: Of the arm.
        wanted: The touch: `start`, `direction`, `reach`, `box_edges`, `X_WB` and `obstacles`.
        guesses: Postures (n,) near which the first one is sought, [rad].
        others: Joint positions of other models by their names.
        config: Of touches.
    """
    z = np.asarray(wanted.direction)
    level = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    level /= np.linalg.norm(level)
    upright = RotationMatrix(np.column_stack([level, np.cross(z, level), z]))
    # One that ends where the object is expected may end before it.
    least = max(0.5 * (wanted.expected + wanted.reach), config.shortest)
    for roll in np.pi * np.arange(_ROLLS) / _ROLLS:
        X_WE = RigidTransform(upright @ RotationMatrix.MakeZRotation(roll), wanted.start)
        found = False
        for q in planner.postures(X_WE, guesses):
            found = True
            planner.look_at(others, believed_obstacles(wanted))
            is_free = planner.is_free(q)
            planner.look_at(others, wanted.obstacles)
            line = planner.line(q, z, wanted.reach) if is_free else q[None]
            if planner.length(line) >= least:
                yield line
        if not found:  # The wrist cannot get there, however it is turned.
            return
