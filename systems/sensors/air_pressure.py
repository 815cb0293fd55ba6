"""Pressure sensors in the air chambers of a soft hand."""

from dataclasses import dataclass

import numpy as np

from maths.arrays import Array
from maths.validation import require
from systems.sensors.randomness import WhiteNoise, make_generator
from systems.sensors.sampled_sensor import SampledSensor


@dataclass(kw_only=True)
class PressureSensorConfig:
    period: float = 0.01  # Between samples, [s].
    tick: float = 1.0 / 15.0  # Between the network's ticks, [s].
    chambers: int = 4  # Number of sensors.
    noise: float = 100.0  # Standard deviation, [Pa].
    bias: float = 300.0  # Standard deviation over episodes, [Pa].
    step: float = 61.0  # Quantisation, 12 bits of the range, [Pa].
    range: float = 150e3  # Largest gauge pressure, [Pa].


class PressureSensor(SampledSensor):
    """Measures the gauge pressure of each chamber with noise, bias, quantisation and saturation.

    p_measured = round_to_step(min(p + bias + noise, range)); the seed draws the bias once per
    episode. The sensor is an absolute one, zeroed to the atmosphere: an empty chamber can read
    slightly below zero.

    .. pydrake_system::

        name: PressureSensor
        input_ports:
        - pressure
        output_ports:
        - pressure_measured
        - pressure_window

    - `pressure`: (chambers,), gauge, [Pa].
    - `pressure_measured`: (chambers,), the last sample, held.
    - `pressure_window`: `SampleWindow` of the samples since the last tick, (K, chambers).

    Source: NXP MPX4250 data sheet, 20 to 250 kPa absolute, 1.4 % of full scale before zeroing;
    12-bit conversion.
    """

    def __init__(self, config: PressureSensorConfig, seed: int) -> None:
        c, name = config, "PressureSensor"
        require(0 < c.period < np.inf, name, c, "period", "> 0 s")
        require(c.period <= c.tick < np.inf, name, c, "tick", ">= period, in s")
        require(c.chambers > 0, name, c, "chambers", "> 0")
        require(0 <= c.noise < np.inf, name, c, "noise", ">= 0 Pa")
        require(0 <= c.bias < np.inf, name, c, "bias", ">= 0 Pa")
        require(0 < c.step < np.inf, name, c, "step", "> 0 Pa")
        require(0 < c.range < np.inf, name, c, "range", "> 0 Pa")
        super().__init__("pressure", "pressure", c.chambers, c.period, c.tick)
        rng = make_generator(seed, "PressureSensor bias")
        self._config = config
        self._bias = c.bias * rng.standard_normal(c.chambers)
        self._noise = WhiteNoise(seed, "PressureSensor noise", c.chambers)

    def measure(self, value: Array, index: int) -> Array:
        c = self._config
        sample = value + self._bias + c.noise * self._noise(index)
        return np.asarray(c.step * np.rint(np.minimum(sample, c.range) / c.step))
