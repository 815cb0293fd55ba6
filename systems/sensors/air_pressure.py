"""Pressure sensors in the air chambers of a soft hand."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD


@dataclass(kw_only=True)
class PressureSensorConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    chambers: int = number(4, at_least=1, at_most=100)  # Number of sensors.
    noise: float = number(100.0, at_least=0.0, at_most=1e6, unit="Pa")  # Standard deviation.
    # Standard deviation over episodes.
    bias: float = number(300.0, at_least=0.0, at_most=1e6, unit="Pa")
    # Quantisation, 12 bits of the range.
    step: float = number(61.0, at_least=1e-6, at_most=1e6, unit="Pa")
    range: float = number(150e3, above=0.0, at_most=1e8, unit="Pa")  # Largest gauge pressure.


class PressureSensor(SampledSensor):
    """Measures the gauge pressure of each chamber with noise, bias, quantisation and saturation.

    p_measured = round_to_step(min(p + bias + noise, range)); the seed draws the bias once per
    episode. The sensor is an absolute one, zeroed to the atmosphere: an empty chamber can read
    slightly below zero.

    Input ports:
    - `pressure`: (chambers,), gauge, [Pa].

    Output ports:
    - `pressure_measured`: (chambers,), the last sample, held.
    - `pressure_window`: `SampleWindow` of the samples since the last tick, (K, chambers).

    Source: NXP MPX4250 data sheet, 20 to 250 kPa absolute, 1.4 % of full scale before zeroing;
    12-bit conversion.
    """

    def __init__(
        self, config: PressureSensorConfig, seed: int, tick: float = NETWORK_PERIOD
    ) -> None:
        c, name = config, "PressureSensor"
        check(c, name)
        super().__init__("pressure", "pressure", c.chambers, c.period, tick)
        rng = make_generator(seed, "PressureSensor bias")
        self._config = config
        self._bias = c.bias * rng.standard_normal(c.chambers)
        self._noise = WhiteNoise(seed, "PressureSensor noise", c.chambers)

    def measure(self, value: Array, index: int) -> Array:
        c = self._config
        sample = value + self._bias + c.noise * self._noise(index)
        return np.asarray(c.step * np.rint(np.minimum(sample, c.range) / c.step))
