"""A held tool as the last link of the arm that holds it: its tip follows a line."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.sequence import Sequence
from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import (
    LineState,
    TipPath,
    ToolLineConfig,
    next_line_state,
)
from crossmodal.controllers.servoing.twists import from_contact
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, require


def tip_twist(X_WT: Array, X_ET: Array, path: TipPath, time: float, gain: float) -> Array:
    """V_WE_E (6,) that takes the tip along its path, [rad/s, m/s].

    The path's own velocity plus `gain` [1/s] times what is left to where the tip should be.

    Args:
        X_WT: Where the tip is (4, 4).
        X_ET: The tool as a link of the arm (4, 4).
        path: Of the tip.
        time: [s]
        gain: [1/s]
    """
    X_WT_desired, V_WT_T = path.at(time)
    left = se3.log(se3.inverse(X_WT) @ X_WT_desired)
    V_T = V_WT_T + gain * left
    R_ET = X_ET[:3, :3]
    return from_contact(np.concatenate([R_ET @ V_T[:3], R_ET @ V_T[3:]]), X_ET[:3, 3])


class ToolLine(Sequence):
    """Moves the estimated tip of a held tool along a straight line on a table.

    The tip T is where the finger touched the free edge of the flap at last: what the robot has
    perceived of the flap's length is L2, from there to the hinge. T_EK and T_KT of the tool as it
    is believed when the flip is done make one link X_ET, fixed from then on; the flap is taken to
    stay at its angle, which its hinge's friction sees to as long as nothing pushes it. The tip goes
    above the line's start, the hinge level and the flap pointing down, then down, then along.

    The line is one of the world, that is, of the table: a robot that believes its base to be
    elsewhere than it is misses the line by that, too. A line in the base's frame would hide it.
    Where the estimators take the arm to be displaced, L1 begins at another place than the arm's
    kinematics puts E at; the difference is taken off for good.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s] of the arm that holds
      the tool.
    - `tool_latest`: `ToolBelief`. May stay unconnected; then the line is not begun.
    - `flip_phase`: (1,) `FlipPhase` of the finger. The tool is taken when the finger begins its
      retreat, and moved when that is done.

    Output ports:
    - `twist_desired`: (6,) V_WE_E, [rad/s, m/s].
    - `phase`: (1,) `LinePhase`.
    - `failure`: str, why the line was not begun or not followed to its end; empty if it was.
    - `tip_estimated`: (3,) p_WT by joints and tool, [m]; NaN before the tool is taken.

    State: `LineState`.

    Frames: W world, E end-effector, K hinge, T tip.

    Args:
        config: The line, speeds and limits.
        arm: The model of the arm that holds the tool, its end-effector E.

    Raises:
        ValueError: for an impossible config value, or a line without length.
    """

    def __init__(self, config: ToolLineConfig, arm: ArmModel) -> None:
        super().__init__(arm)
        check(config, "ToolLine")
        apart = bool(np.linalg.norm(config.end - config.start) > 0.0)
        require(apart, "ToolLine", config, "end", "a point other than start")
        self._config = config
        self._tool = self.DeclareAbstractInputPort("tool_latest", Value[object]())
        self._flip = self.DeclareVectorInputPort("flip_phase", 1)
        self._declare_state(LineState(), config.period)
        moving = self._on_state | {self._joint_state.ticket()}
        self._declare_vector("twist_desired", 6, self._calc_twist, moving | self._on_time)
        self._declare_vector("phase", 1, lambda c: self._state(c).phase, self._on_state)
        self._declare_value("failure", "", lambda c: self._state(c).why, self._on_state)
        self._declare_vector("tip_estimated", 3, self._calc_tip, moving)

    def _calc_twist(self, context: Context) -> Array:
        state = self._state(context)
        if state.path is None or state.X_ET is None:
            return np.zeros(6)
        X_WT = state.tip(self._arm_state(context).X_WE)
        return tip_twist(X_WT, state.X_ET, state.path, context.get_time(), self._config.gain)

    def _calc_tip(self, context: Context) -> Array:
        state = self._state(context)
        if state.X_ET is None:
            return np.full(3, np.nan)
        return np.asarray(state.tip(self._arm_state(context).X_WE)[:3, 3])

    def _next(self, context: Context) -> LineState:
        return next_line_state(
            self._state(context),
            context.get_time(),
            self._arm_state(context).X_WE,
            FlipPhase(int(self._flip.Eval(context)[0])),
            self._tool.Eval(context) if self._tool.HasValue(context) else None,
            self._config,
        )
