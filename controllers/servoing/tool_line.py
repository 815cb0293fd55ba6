"""A held tool as the last link of the arm that holds it: its tip follows a line."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import (
    LineState,
    ToolLineConfig,
    Way,
    next_line_state,
)
from crossmodal.controllers.servoing.twists import from_contact
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, require


def tip_twist(X_WT: Array, X_ET: Array, way: Way, time: float, gain: float) -> Array:
    """V_WE_E (6,) that takes the tip along its way, [rad/s, m/s].

    The way's own velocity plus `gain` [1/s] times what is left to where the tip should be.

    Args:
        X_WT: Where the tip is (4, 4).
        X_ET: The tool as a link of the arm (4, 4).
        way: Of the tip.
        time: [s]
        gain: [1/s]
    """
    X_WT_desired, V_WT_T = way.at(time)
    left = se3.log(se3.inverse(X_WT) @ X_WT_desired)
    V_T = V_WT_T + gain * left
    R_ET = X_ET[:3, :3]
    return from_contact(np.concatenate([R_ET @ V_T[:3], R_ET @ V_T[3:]]), X_ET[:3, 3])


class ToolLine(LeafSystem):
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

    .. pydrake_system::

        name: ToolLine
        input_ports:
        - joint_state_measured
        - tool_latest
        - flip_phase
        output_ports:
        - twist_desired
        - phase
        - failure
        - tip_estimated

    - joint_state_measured: (2 n,) positions [rad] and velocities [rad/s] of the arm that holds the
      tool.
    - tool_latest: `ToolBelief`. May stay unconnected; then the line is not begun.
    - flip_phase: (1,) `FlipPhase` of the finger. The tool is taken when the finger begins its
      retreat, and moved when that is done.
    - twist_desired: (6,) V_WE_E, [rad/s, m/s].
    - phase: (1,) `LinePhase`.
    - failure: str, why the line was not begun or not followed to its end; empty if it was.
    - tip_estimated: (3,) p_WT by joints and tool, [m]; NaN before the tool is taken.

    State: `LineState`.

    Frames: W world, E end-effector, K hinge, T tip.

    Args:
        config: The line, speeds and limits.
        arm: The model of the arm that holds the tool, its end-effector E.

    Raises:
        ValueError: for an impossible config value, or a line without length.
    """

    def __init__(self, config: ToolLineConfig, arm: ArmModel) -> None:
        super().__init__()
        check(config, "ToolLine")
        apart = bool(np.linalg.norm(config.end - config.start) > 0.0)
        require(apart, "ToolLine", config, "end", "a point other than start")
        self._config, self._arm = config, arm
        self._joints = self.DeclareVectorInputPort("joint_state_measured", 2 * arm.num_joints)
        self._tool = self.DeclareAbstractInputPort("tool_latest", Value[object]())
        self._flip = self.DeclareVectorInputPort("flip_phase", 1)
        state = self.abstract_state_ticket(self.DeclareAbstractState(Value[object](LineState())))
        moving = {state, self._joints.ticket()}
        self.DeclareVectorOutputPort(
            "twist_desired", 6, self._calc_twist, moving | {self.time_ticket()}
        )
        self.DeclareVectorOutputPort(
            "phase", 1, lambda c, out: out.SetFromVector([self._state(c).phase]), {state}
        )
        self.DeclareAbstractOutputPort(
            "failure",
            lambda: AbstractValue.Make(""),
            lambda c, out: out.set_value(self._state(c).why),
            {state},
        )
        self.DeclareVectorOutputPort("tip_estimated", 3, self._calc_tip, moving)
        self.DeclarePeriodicUnrestrictedUpdateEvent(config.period, 0.0, self._update)

    def _state(self, context: Context) -> LineState:
        state: LineState = context.get_abstract_state(0).get_value()
        return state

    def _X_WE(self, context: Context) -> Array:
        return self._arm.Evaluate(np.asarray(self._joints.Eval(context))).X_WE

    def _calc_twist(self, context: Context, output: BasicVector) -> None:
        state, V_WE_E = self._state(context), np.zeros(6)
        if state.way is not None and state.X_ET is not None:
            X_WT = state.tip(self._X_WE(context))
            V_WE_E = tip_twist(X_WT, state.X_ET, state.way, context.get_time(), self._config.gain)
        output.SetFromVector(V_WE_E)

    def _calc_tip(self, context: Context, output: BasicVector) -> None:
        state = self._state(context)
        known = state.X_ET is not None
        p_WT = state.tip(self._X_WE(context))[:3, 3] if known else np.full(3, np.nan)
        output.SetFromVector(p_WT)

    def _update(self, context: Context, state: State) -> None:
        tool: Any = self._tool.Eval(context) if self._tool.HasValue(context) else None
        following = next_line_state(
            self._state(context),
            context.get_time(),
            self._X_WE(context),
            FlipPhase(int(self._flip.Eval(context)[0])),
            tool,
            self._config,
        )
        state.get_mutable_abstract_state(0).set_value(following)
