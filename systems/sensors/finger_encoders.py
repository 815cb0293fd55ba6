"""Encoders of a gripper's sliding fingers."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD


@dataclass(kw_only=True)
class FingerEncodersConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    # Quantisation, 8 bits of a travel of 70 mm.
    step: float = number(2.8e-4, at_least=1e-9, at_most=0.1, unit="m")


class FingerEncoders(SampledSensor):
    """Measures how far each finger of a gripper is open, in steps.

    Input ports:
    - `finger_positions`: (m,) of the fingers' joints, 0 closed, [m].

    Output ports:
    - `hand_positions_measured`: (m,), the last sample, held, [m].
    - `hand_positions_window`: `SampleWindow` of the samples since the last tick, (K, m).
    """

    def __init__(
        self, config: FingerEncodersConfig, fingers: int, tick: float = NETWORK_PERIOD
    ) -> None:
        check(config, "FingerEncoders")
        super().__init__("finger_positions", "hand_positions", fingers, config.period, tick)
        self._step = config.step

    def measure(self, value: Array, index: int) -> Array:
        return np.asarray(self._step * np.rint(value / self._step))
