"""What is believed of the hand that holds a body."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, numbers, require


@dataclass(kw_only=True)
class HandConfig:
    # Mass of what hangs on the wrist sensor.
    mass: float = number(0.628, at_least=0.0, at_most=100.0, unit="kg")
    # Centre of that mass, in the sensor's frame.
    p_S_com: np.ndarray = numbers(
        np.array([0.004, 0.0, 0.066]), at_least=-10.0, at_most=10.0, unit="m"
    )
    # Sensor in E.
    rpy_ES: np.ndarray = numbers(np.zeros(3), at_least=-10.0, at_most=10.0, unit="rad")
    # Direction of the bar, about which the fingers curl.
    axis_H: np.ndarray = numbers(np.array([0.0, 1.0, 0.0]), at_least=-10.0, at_most=10.0)
    # Point on the bar.
    p_HA: np.ndarray = numbers(np.array([0.0, 0.0, -0.02]), at_least=-10.0, at_most=10.0, unit="m")
    # Of the bent hand's error, a Gauss-Markov process.
    correlation_time: float = number(30.0, at_least=1e-3, at_most=1e5, unit="s")
    # Slip of a body in the hand, a random walk over the hand's displacement.
    slip_rotation: float = number(0.03, at_least=0.0, at_most=100.0, unit="rad/m^0.5")
    # The same for the translation.
    slip_translation: float = number(2.0e-3, at_least=0.0, at_most=10.0, unit="m/m^0.5")

    @property
    def grasping_axis(self) -> tuple[Array, Array]:
        """A unit vector (3,) in H, about which the fingers curl, and a point on it (3,)."""
        axis = np.asarray(self.axis_H, dtype=float)
        return axis / np.linalg.norm(axis), np.asarray(self.p_HA, dtype=float)

    @property
    def slip(self) -> Array:
        """Variances (6,) of a body's slip over a metre of the hand's displacement."""
        return np.repeat([self.slip_rotation**2, self.slip_translation**2], 3)


def check_hand(config: HandConfig, system: str) -> None:
    """Raises ValueError, naming the first impossible value."""
    check(config, system)
    length = float(np.linalg.norm(config.axis_H))
    require(length > 1e-6, system, config, "axis_H", "a direction")
