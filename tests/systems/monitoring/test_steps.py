"""What steps from one sample to the next, and what only changes fast."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.offsets import OFFSET, Offsets
from crossmodal.systems.monitoring.steps import IsolatedSteps, StepsConfig, find_steps
from crossmodal.systems.port_values import SampleWindow

CONFIG = StepsConfig()
STEP = 0.01
NOISE = np.array([100.0, 100.0])


def readings(seed: int, count: int) -> tuple[Array, Array]:
    """Stamps (K,) and noisy samples (K, 2) about 60 kPa."""
    rng = np.random.default_rng(seed)
    return STEP * np.arange(count), 6e4 + NOISE * rng.standard_normal((count, 2))


def passed(times: Array, values: Array, model: IsolatedSteps) -> tuple[Array, list[str], Array]:
    """All samples as they pass, seven a tick; what is detected after each; the last variances."""
    state: Offsets | None = None
    found, told, window = [], [], SampleWindow(times=times, values=values)
    for k in range(0, len(times), 7):
        part = SampleWindow(times=times[k : k + 7], values=values[k : k + 7])
        window, state = model.take_out(part, state, None)
        found.append(window.values)
        told.append(state.fault if state is not None else "")
    return np.concatenate(found), told, window.variances


def test_noise_passes_to_the_last_digit() -> None:
    times, values = readings(0, 3000)
    found, told, variances = passed(times, values, IsolatedSteps(CONFIG, NOISE))
    assert_array_equal(found, values)
    assert not any(told)
    assert not variances.any()


def test_a_step_is_taken_out_within_a_tick_as_surely_as_is_said() -> None:
    z = []
    for seed in range(100):
        times, values = readings(seed, 70)
        failing = values.copy()
        failing[20 + seed % 7 :, 0] += 5e3
        found, told, variances = passed(times, failing, IsolatedSteps(CONFIG, NOISE))
        assert told[:2] == ["", ""]
        assert told[4:] == [OFFSET] * 6
        left = (found - values)[42:, 0]
        assert_allclose(left, left[0], atol=1e-6)
        z.append(left[0] / np.sqrt(variances[0]))
    assert 0.7 < np.std(z) < 1.3


def test_a_step_back_leaves_nothing() -> None:
    times, values = readings(1, 140)
    failing = values.copy()
    failing[35:80] += 5e3
    found, told, variances = passed(times, failing, IsolatedSteps(CONFIG, NOISE))
    assert told[-1] == ""
    assert_array_equal(found[100:], values[100:])
    assert not variances.any()


@pytest.mark.parametrize("time_constant", [0.02, 0.05, 0.15])
def test_air_that_flows_does_not_step(time_constant: float) -> None:
    """A chamber that fills by 60 kPa, and one that empties into the atmosphere."""
    times, values = readings(2, 140)
    flow = 6e4 * (1.0 - np.exp(-np.maximum(times - 0.5, 0.0) / time_constant))
    values += np.column_stack([flow, -flow])
    assert not find_steps(times, values, NOISE, CONFIG)


def test_a_ramp_of_any_slope_is_no_step() -> None:
    times, values = readings(3, 100)
    for slope in (1e3, 1e5, 1e7):
        ramp = values + slope * np.clip(times - 0.4, 0.0, 0.2)[:, None]
        assert not find_steps(times, ramp, NOISE, CONFIG)


def test_a_step_on_a_slope_has_its_own_size() -> None:
    times, values = readings(4, 60)
    values += 2e4 * times[:, None]
    values[30:, 0] += 8e3
    (step,) = find_steps(times, values, NOISE, CONFIG)
    assert_allclose(step.time, times[30])
    assert_allclose(step.since, times[29])
    assert np.all(np.abs(step.size - [8e3, 0.0]) < 4.0 * np.sqrt(step.variance))


def test_what_happens_in_a_pause_is_no_step() -> None:
    times, values = readings(5, 60)
    values[30:] += 5e3
    kept = (np.arange(60) < 26) | (np.arange(60) >= 30)
    assert not find_steps(times[kept], values[kept], NOISE, CONFIG)


def test_a_step_that_is_felt_is_real() -> None:
    times, values = readings(6, 70)
    values[30:] += 5e3
    joints = SampleWindow(times=times, values=np.zeros((70, 2)))
    model = IsolatedSteps(CONFIG, NOISE, lambda step, motion: True)
    window, after = model.take_out(SampleWindow(times=times, values=values), None, joints)
    assert_array_equal(window.values, values)
    assert after is not None
    assert after.fault == ""
    sure = IsolatedSteps(CONFIG, NOISE, lambda step, motion: False)
    taken_out, _ = sure.take_out(SampleWindow(times=times, values=values), None, joints)
    assert_allclose(taken_out.values[30:], values[30:] - 5e3, atol=600.0)
    # Without encoders nobody can say.
    _, unknown = sure.take_out(SampleWindow(times=times, values=values), None, None)
    assert unknown is not None
    assert unknown.fault == ""
