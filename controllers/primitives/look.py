"""Carries a camera to the views that are wanted, then out of the way."""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.joint_motion import JointMotion, resting
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.controllers.primitives.arm_task import ArmTask, TransitConfig, believed_obstacles
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class LookConfig:
    period: float = number(0.05, at_least=1e-3, at_most=1.0, unit="s")  # Between decisions.
    transit: TransitConfig = field(default_factory=TransitConfig)
    # For which an image is waited for where the camera rests.
    patience: float = number(2.0, above=0.0, at_most=60.0, unit="s")


class LookPhase(StrEnum):
    """What the camera's arm does."""

    WAIT = ""
    MOVE = "moves the camera"
    LOOK = "looks"
    HOME = "moves the camera away"


@dataclass(frozen=True, kw_only=True)
class LookState(Immutable):
    """What is done, and how the arm moves.

    Attributes:
        phase: What it does.
        motion: Of the arm.
        trail: Postures (K, n) through which it came from home to where it is, [rad].
        number: Of the view that it goes to or is at.
        looked: Of the last view at which the camera has come to rest.
        unreachable: Of the last view that it cannot get to; zero if it got to all.
        failure: Why nothing more can be done; empty while it can.
    """

    motion: JointMotion
    trail: Array
    phase: LookPhase = LookPhase.WAIT
    number: int = 0
    looked: int = 0
    unreachable: int = 0
    failure: str = ""


class Look(ArmTask):
    """Goes to each view that is wanted, and home when a touch or nothing is wanted.

    Input ports:
    - those of `ArmTask`.
    - `view_latest`: with `number` and `X_WC` (4, 4) of the view that is wanted, the box
      `box_edges`, `X_WB` that holds the object, and what holds all others, `obstacles`; or with
      `home`, if the camera is to be away.
    - `touch_latest`: with `number` and `done`; while a touch is wanted, the arm stays at home.
    - `depth_measured`, `color_measured`: the camera's last images, with `time`. The latter may stay
      unconnected.

    Output ports:
    - `joint_position_commanded`: (n,), [rad].
    - `looked`: (1,) number of the last view at which the camera rests and of which there are
      images; it stays until the next one.
    - `unreachable`: (1,) number of the last view that the arm cannot get to.
    - `is_away`: (1,) 1 while the arm is at home.
    - `phase`: str.
    - `failure`: str, why nothing more can be done; empty while it can.

    State: `LookState`.

    Frames: W world, C camera, which is the arm's end-effector.

    Args:
        config: Of the motions.
        arm: The robot's own model.
        planner: Of this arm.
        q_home: Where it begins and ends (n,), [rad].
        others: Numbers of joints of other arms by the names of their models.
    """

    def __init__(
        self,
        config: LookConfig,
        arm: ArmModel,
        planner: MotionPlanner,
        q_home: Array,
        others: dict[str, int],
    ) -> None:
        check(config, "Look")
        super().__init__(arm, planner, config.transit, others)
        self._q_home, self._patience = q_home, config.patience
        self._view = self.DeclareAbstractInputPort("view_latest", Value[object]())
        self._touch = self.DeclareAbstractInputPort("touch_latest", Value[object]())
        self._depth = self.DeclareAbstractInputPort("depth_measured", Value[object]())
        self._colour = self.DeclareAbstractInputPort("color_measured", Value[object]())
        self._declare_state(LookState(motion=resting(q_home), trail=q_home[None]), config.period)
        self._declare_command()
        self._declare_vector("looked", 1, lambda c: self._state(c).looked, self._on_state)
        self._declare_vector("unreachable", 1, lambda c: self._state(c).unreachable, self._on_state)
        self._declare_vector("is_away", 1, self._is_away)
        self._declare_value("failure", "", lambda c: self._state(c).failure, self._on_state)
        self._declare_value("phase", "", lambda c: str(self._state(c).phase), self._on_state)

    def _is_away(self, context: Context) -> float:
        motion = self._state(context).motion
        at_rest = context.get_time() >= motion.end
        return float(at_rest and np.array_equal(motion.knots[-1], self._q_home))

    def _next(self, context: Context) -> LookState:
        state: LookState = self._state(context)
        time = context.get_time()
        rested = state.motion.end + self._transit.rest_time * (state.phase is LookPhase.MOVE)
        if time < rested or state.failure:
            return state
        if state.phase is LookPhase.MOVE:
            images = [self._depth, *(port for port in [self._colour] if port.HasValue(context))]
            if min(port.Eval(context).time for port in images) >= rested:
                return replace(state, phase=LookPhase.LOOK, looked=state.number)
            if time > rested + self._patience:
                why = f"the camera has given no image for {self._patience:g} s"
                return replace(state, phase=LookPhase.WAIT, failure=why)
            return state
        touch, view = self._touch.Eval(context), self._view.Eval(context)
        if touch.number > 0 or touch.done or view.home:
            return self._home(context, state)
        if view.number > state.number:
            return self._begin(context, state, view)
        return state

    def _home(self, context: Context, state: LookState) -> LookState:
        if np.array_equal(state.motion.knots[-1], self._q_home):
            return replace(state, phase=LookPhase.WAIT)
        # What is believed of the object may have changed so that there is no way: back as it came.
        path = self._path(context, self._q_home, seed=0)
        motion = self._motion(state.trail[::-1] if path is None else path, context)
        return replace(state, phase=LookPhase.HOME, motion=motion, trail=self._q_home[None])

    def _begin(self, context: Context, state: LookState, view: Any) -> LookState:
        number, X_WC = view.number, RigidTransform(view.X_WC)
        self._look_around(context)
        here = state.motion.knots[-1]
        goal = self._planner.posture(X_WC, [here, self._q_home])
        path = None if goal is None else self._path(context, goal, number)
        if path is None:
            return replace(state, number=number, unreachable=number)
        motion, trail = self._motion(path, context), np.vstack([state.trail, path[1:]])
        return replace(state, phase=LookPhase.MOVE, motion=motion, trail=trail, number=number)

    def _path(self, context: Context, goal: Array, seed: int) -> Array | None:
        self._look_around(context)
        rng = np.random.default_rng(seed)
        return self._planner.path(self._state(context).motion.knots[-1], goal, rng)

    def _look_around(self, context: Context) -> None:
        obstacles = believed_obstacles(self._view.Eval(context))
        self._planner.look_at(self._others_now(context), obstacles)
