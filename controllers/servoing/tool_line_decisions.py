"""How the tip of a held tool comes to a line and follows it, and when that is not begun."""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from crossmodal.controllers.arm.minimum_jerk import PEAK_RATE, minimum_jerk
from crossmodal.controllers.servoing.contact_search import is_there
from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number, numbers

_LEAST_TIME = 0.5  # Shortest duration of a motion, [s].
_UPRIGHT = 0.9  # Share of a hinge's direction that points up, beyond which it is not laid level.


class LinePhase(IntEnum):
    """In the order in which they follow."""

    WAIT = 0
    APPROACH = 1
    LOWER = 2
    LINE = 3
    DONE = 4
    FAILED = 5


@dataclass(kw_only=True)
class ToolLineConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Where the line begins, in the world: 5 mm above the table as its end is, for the tip is the
    # middle of an edge that is 5 to 8 mm thick.
    start: np.ndarray = numbers(
        np.array([0.575, 0.05, 0.175]), at_least=-10.0, at_most=10.0, unit="m"
    )
    # Where the line ends, in the world.
    end: np.ndarray = numbers(
        np.array([0.425, 0.05, 0.175]), at_least=-10.0, at_most=10.0, unit="m"
    )
    # Height above the line's start to which the tip goes first.
    above: float = number(0.08, at_least=0.0, at_most=1.0, unit="m")
    # Angle by which the flap points down, from the hinge to the tip; the hinge itself is level.
    slope: float = number(0.26, at_least=0.0, at_most=1.57, unit="rad")
    # Highest speed of the tip on its way to above the line.
    travel_speed: float = number(0.12, above=0.0, at_most=1.0, unit="m/s")
    # Highest rate at which the tip turns.
    turn_speed: float = number(0.4, above=0.0, at_most=3.0, unit="rad/s")
    # Highest speed of the tip along the line and down to it.
    line_speed: float = number(0.04, above=0.0, at_most=1.0, unit="m/s")
    # With which the tip is drawn to where it should be.
    gain: float = number(2.0, at_least=0.0, at_most=50.0, unit="1/s")
    # How near the tip has to get to the end of each path.
    arrival_distance: float = number(0.001, above=0.0, at_most=0.1, unit="m")
    # How far the tip may be turned from how it should be at the end of each path.
    arrival_angle: float = number(0.01, above=0.0, at_most=1.0, unit="rad")
    # How late the tip may be at the end of each path.
    arrival_time: float = number(4.0, above=0.0, at_most=3600.0, unit="s")
    # A tool is not used of which a vector's reported standard deviation is larger.
    largest_deviation: float = number(0.03, above=0.0, at_most=1.0, unit="m")


class TipPath(NamedTuple):
    """From rest to rest along a straight line, turning about a fixed axis.

    Attributes:
        start: [s]
        duration: [s]
        X_WT_start: (4, 4).
        X_WT_end: (4, 4).
    """

    start: float
    duration: float
    X_WT_start: Array
    X_WT_end: Array

    def at(self, time: float) -> tuple[Array, Array]:
        """X_WT (4, 4) and V_WT_T (6,) at a time [s]."""
        blend, rate, _ = minimum_jerk((time - self.start) / self.duration)
        R_WT = np.ascontiguousarray(self.X_WT_start[:3, :3])
        turn = se3.so3_log(R_WT.T @ np.ascontiguousarray(self.X_WT_end[:3, :3]))
        p_WT, shift = self.X_WT_start[:3, 3], self.X_WT_end[:3, 3] - self.X_WT_start[:3, 3]
        X_WT = np.eye(4)
        X_WT[:3, :3] = R_WT @ se3.so3_exp(blend * turn)
        X_WT[:3, 3] = p_WT + blend * shift
        velocity = np.concatenate([turn, X_WT[:3, :3].T @ shift])
        return X_WT, rate / self.duration * velocity


@dataclass(frozen=True, kw_only=True)
class LineState(Immutable):
    """What is remembered of it.

    Attributes:
        phase: What is done.
        X_ET: The tool as a link of the arm (4, 4); None before the flap is turned.
        displacement: Of E as the arm's kinematics has it from where the estimators take it to be,
            in the world (3,), [m].
        path: Of the tip in this phase; None before it moves.
        why: Why it was not begun or has failed, in words; empty if neither.
    """

    phase: LinePhase = LinePhase.WAIT
    X_ET: Array | None = None
    displacement: Array = field(default_factory=lambda: np.zeros(3))
    path: TipPath | None = None
    why: str = ""

    def tip(self, X_WE: Array) -> Array:
        """X_WT (4, 4) of a tool that is known, of E as measured (4, 4)."""
        assert self.X_ET is not None
        X_WT: Array = X_WE @ self.X_ET
        X_WT[:3, 3] -= self.displacement
        return X_WT


def unusable(tool: Any, largest_deviation: float) -> str:
    """Why a `ToolBelief` is no link of an arm, in words; empty for one that is.

    Args:
        tool: None for a belief that nobody gives.
        largest_deviation: Of L1 or L2 in any direction, as claimed, [m].
    """
    if tool is None or not tool.hinge.known:
        return "the tool is not known"
    if not (np.isfinite(tool.X_EK @ tool.X_KT).all() and np.isfinite(tool.L1_W).all()):
        return "the tool is not known"
    for name, covariance in (("L1", tool.L1_covariance), ("L2", tool.L2_covariance)):
        deviation = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        if not deviation <= largest_deviation:
            return f"{name} of the tool is known to {1e3 * deviation:.0f} mm only"
    return ""


def posture_on_table(R_WT: Array, slope: float) -> Array:
    """R_WT (3, 3) with the hinge (z) level and the flap (x) pointing down by `slope` [rad].

    The heading of the flap stays.
    """
    up = np.array([0.0, 0.0, 1.0])
    level = R_WT[:, 2] - up * R_WT[2, 2]
    z = level / np.linalg.norm(level)
    ahead = np.cross(z, up)
    ahead *= np.copysign(1.0, ahead @ R_WT[:, 0])
    x = np.cos(slope) * ahead - np.sin(slope) * up
    return np.column_stack([x, np.cross(z, x), z])


def next_line_state(
    state: LineState,
    time: float,
    X_WE: Array,
    flip: FlipPhase,
    tool: Any,
    config: ToolLineConfig,
) -> LineState:
    """One step.

    Args:
        state: Before it.
        time: [s]
        X_WE: Of the arm that holds the tool, as measured (4, 4).
        flip: What the finger does.
        tool: `ToolBelief`; the one at the end of the flip becomes a link of the arm. None without.
    """
    if state.phase in (LinePhase.DONE, LinePhase.FAILED) or flip == FlipPhase.FAILED:
        return state
    if state.X_ET is None:
        if flip not in (FlipPhase.RETREAT, FlipPhase.DONE):
            return state
        why = unusable(tool, config.largest_deviation)
        if why:
            why = f"the line on the table is not begun: {why}"
            return replace(state, phase=LinePhase.FAILED, why=why)
        p_WE = tool.hinge.p_WK - tool.L1_W
        return replace(state, X_ET=tool.X_EK @ tool.X_KT, displacement=X_WE[:3, 3] - p_WE)
    X_WT = state.tip(X_WE)
    if state.path is None:
        if flip != FlipPhase.DONE:
            return state
        if abs(X_WT[2, 2]) > _UPRIGHT:
            why = "the line on the table is not begun: the hinge stands upright"
            return replace(state, phase=LinePhase.FAILED, why=why)
        return _enter(LinePhase.APPROACH, state, time, X_WT, config)
    goal, left = state.path.X_WT_end, state.path.start + state.path.duration - time
    if left > 0.0:
        return state
    if is_there(X_WT, goal, config.arrival_distance, config.arrival_angle):
        return _enter(LinePhase(state.phase + 1), state, time, goal, config)
    if -left > config.arrival_time:
        why = f"the arm that holds the tool does not reach {_NAMES[state.phase]}"
        return replace(state, phase=LinePhase.FAILED, path=None, why=why)
    return state


_NAMES = {
    LinePhase.APPROACH: "the place above the line on the table",
    LinePhase.LOWER: "the start of the line on the table",
    LinePhase.LINE: "the end of the line on the table",
}


def _enter(
    phase: LinePhase, state: LineState, time: float, X_WT: Array, config: ToolLineConfig
) -> LineState:
    """The state at the beginning of a phase that starts at `X_WT` (4, 4)."""
    if phase == LinePhase.DONE:
        return replace(state, phase=phase, path=None)
    goal = X_WT.copy()
    if phase == LinePhase.APPROACH:
        goal[:3, :3] = posture_on_table(X_WT[:3, :3], config.slope)
        goal[:3, 3] = config.start + np.array([0.0, 0.0, config.above])
    else:
        goal[:3, 3] = config.start if phase == LinePhase.LOWER else config.end
    shift = float(np.linalg.norm(goal[:3, 3] - X_WT[:3, 3]))
    R = np.ascontiguousarray(X_WT[:3, :3].T @ goal[:3, :3])
    turn = float(np.linalg.norm(se3.so3_log(R)))
    speed = config.travel_speed if phase == LinePhase.APPROACH else config.line_speed
    duration = max(PEAK_RATE * max(shift / speed, turn / config.turn_speed), _LEAST_TIME)
    return replace(state, phase=phase, path=TipPath(time, duration, X_WT, goal))
