"""The soft hand as a spring: a filter that takes the place of `hand_bending`."""

from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    HandLoad,
    PoseBelief,
    no_samples,
)
from crossmodal.systems.proprioception.hand_bending import HandBendingConfig, load_reading
from crossmodal.systems.recursive_filter import RecursiveFilter

PALM = np.array([0.0, 0.0, 0.06])  # Where the spring is, in the wrist sensor's frame, [m].
TURN = np.array([0.24, 0.33, 0.28])  # By a torque about the palm, [rad/(N m)].
SHIFT = np.array([0.0, 0.0, 1.3e-3])  # By a force, [m/N].
FLOOR = np.repeat([0.005, 0.5e-3], 3)  # Least standard deviation, [rad, m].
SHARE = 0.4  # Standard deviation as a share of the bending.


@dataclass(frozen=True, kw_only=True)
class Spring:
    """The load now and when the hand closed (6,), None before, and log X_EH (6,)."""

    load: HandLoad = UNKNOWN_LOAD
    at_rest: np.ndarray | None = None
    bent: np.ndarray = field(default_factory=lambda: np.zeros(6))


def bending(F_S: np.ndarray) -> np.ndarray:
    """How a load (6,), torque [N m] then force [N], bends the hand, log X_EH (6,)."""
    torque = F_S[:3] - np.cross(PALM, F_S[3:])
    return np.concatenate([TURN * torque, SHIFT * F_S[3:]])


def belief(spring: Spring) -> PoseBelief:
    """X_EH; the spring is wrong in the same way at every tick, so that averaging helps nothing."""
    deviation = FLOOR + SHARE * np.abs(spring.bent)
    return PoseBelief(X=se3.exp(spring.bent), covariance=np.diag(deviation**2))


class SpringBending(RecursiveFilter):
    """How far the hand has bent since it closed, in proportion to what has pulled on it since."""

    def __init__(self, config: HandBendingConfig) -> None:
        super().__init__()
        self._hand = config.hand
        self._wrench = self._declare_value_input("wrench_window", no_samples(6))
        self._pressure = self._declare_value_input("pressure_window", no_samples(4))
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._declare_recursion(Spring(), self._calc, config.period)
        self._declare_estimated("hand_bending_estimated", belief)
        self._declare_latest("hand_bending_latest", belief)
        self._declare_estimated("hand_load_estimated", lambda spring: spring.load)

    def _calc(self, context, spring):
        wrench, pressure = (self._read(p, context) for p in (self._wrench, self._pressure))
        if wrench.times.size == 0 or pressure.times.size == 0:
            return replace(spring, load=UNKNOWN_LOAD)
        R_WE = self._read(self._end_effector, context).X[:3, :3]  # The sensor has these axes, too.
        read = load_reading(wrench, pressure, R_WE, self._hand.mass, self._hand.p_S_com)
        now = Spring(load=HandLoad(F_S=read[:6], pressures=read[6:]), at_rest=spring.at_rest)
        if self._active.Eval(context)[0] <= 0.5:  # It holds nothing.
            return replace(now, at_rest=None)
        if now.at_rest is None:
            return replace(now, at_rest=read[:6])
        return replace(now, bent=bending(read[:6] - now.at_rest))
