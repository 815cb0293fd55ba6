import numpy as np
import pytest

from crossmodal.systems.sensors.air_pressure import PressureSensor, PressureSensorConfig


def test_noise_and_bias_have_their_deviations():
    config = PressureSensorConfig()
    sensor = PressureSensor(config, 0)
    pressure = np.array([0.0, 1e4, 2e4, 5e4])
    samples = np.array([sensor.measure(pressure, k) for k in range(4000)])
    expected = np.sqrt(config.noise**2 + config.step**2 / 12.0)
    np.testing.assert_allclose(samples.std(axis=0), expected, rtol=0.06)
    quiet = PressureSensorConfig(noise=0.0)
    biases = [PressureSensor(quiet, seed).measure(pressure, 0) - pressure for seed in range(1000)]
    np.testing.assert_allclose(np.std(biases, axis=0), config.bias, rtol=0.08)


def test_measurements_come_in_steps_and_end_at_the_range():
    config = PressureSensorConfig(noise=0.0, bias=0.0, chambers=2)
    measured = PressureSensor(config, 0).measure(np.array([1234.0, 1e6]), 0)
    np.testing.assert_allclose(measured / config.step, np.round(measured / config.step))
    assert abs(measured[0] - 1234.0) <= 0.5 * config.step
    assert abs(measured[1] - config.range) <= 0.5 * config.step


def test_the_number_of_chambers_sets_the_ports():
    sensor = PressureSensor(PressureSensorConfig(chambers=6), 0)
    assert sensor.GetInputPort("pressure").size() == 6
    assert sensor.GetOutputPort("pressure_measured").size() == 6


@pytest.mark.parametrize(("field", "value"), [("noise", -1.0), ("step", 0.0), ("chambers", 0)])
def test_impossible_values_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=f"PressureSensor: {field}"):
        PressureSensor(PressureSensorConfig(**{field: value}), 0)
