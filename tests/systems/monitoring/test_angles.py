"""Angles that jump or drift are brought back to where their rates lead, as surely as is said."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.angles import AngleOffsets, AnglesConfig, follow_rates
from crossmodal.systems.monitoring.offsets import DRIFTING, OFFSET

CONFIG = AnglesConfig()
STEP, TICK = 0.005, 1.0 / 15.0


def encoders(seed: int, duration: float) -> tuple[Array, Array]:
    """Stamps (K,) and samples (K, 6) of three joints that swing, with an encoder's noise."""
    rng = np.random.default_rng(seed)
    times = STEP * np.arange(1, round(duration / STEP) + 1)
    rate, phase = np.array([0.0, 0.7, 1.5]), rng.uniform(0.0, 6.0, 3)
    angle = rate * times[:, None] + phase
    q = 0.2 * np.sin(angle) + CONFIG.noise.angle * rng.standard_normal(angle.shape)
    v = 0.2 * rate * np.cos(angle) + CONFIG.noise.rate * rng.standard_normal(angle.shape)
    return times, np.hstack([q, v])


def followed(times: Array, samples: Array) -> tuple[Array, list[AngleOffsets]]:
    """All samples without their offsets, and what is remembered after each tick."""
    state: AngleOffsets | None = None
    passed, states = [], []
    for tick in range(1, round(times[-1] / TICK) + 1):
        mine = (times > TICK * (tick - 1) + 1e-9) & (times <= TICK * tick + 1e-9)
        values, state = follow_rates(times[mine], samples[mine], state, CONFIG)
        passed.append(values)
        assert state is not None
        states.append(state)
    return np.concatenate(passed), states


def test_healthy_samples_pass_to_the_last_digit() -> None:
    for seed in range(10):
        times, samples = encoders(seed, 20.0)
        passed, states = followed(times, samples)
        assert_array_equal(passed, samples[: len(passed)])
        assert not any(state.fault for state in states)


def test_a_jump_is_taken_out_at_once_and_forgotten_once_it_has_gone() -> None:
    times, samples = encoders(0, 3.0)
    failing = samples.copy()
    failing[(times > 1.0) & (times <= 2.0), 1] += 0.05
    passed, states = followed(times, failing)
    assert_allclose(passed, samples[: len(passed)], atol=2e-3)
    told = [state.fault for state in states]
    assert told == [""] * 15 + [OFFSET] * 15 + [""] * 15
    assert_array_equal(passed[times[: len(passed)] > 2.0], samples[(times > 2.0)][: len(passed)])


def test_a_drift_is_told_within_half_a_second_and_taken_out() -> None:
    for seed in range(10):
        times, samples = encoders(seed, 5.0)
        failing = samples.copy()
        failing[:, 0] += 5e-3 * np.clip(times - 1.0, 0.0, 2.0)
        passed, states = followed(times, failing)
        told = [state.fault for state in states]
        first = TICK * (told.index(DRIFTING) + 1)
        assert 1.0 < first < 1.5
        late = times[: len(passed)] > first
        assert_allclose(passed[late, 0], samples[: len(passed)][late, 0], atol=2e-3)
        assert told[-1] == OFFSET  # It stays off by 10 mrad.


def test_what_is_left_of_an_offset_has_the_variance_that_is_said() -> None:
    z = []
    for seed in range(40):
        times, samples = encoders(seed, 5.0)
        failing = samples.copy()
        failing[times > 1.0, 0] += 0.05
        failing[:, 0] += 5e-3 * np.clip(times - 2.0, 0.0, 1.0)
        passed, states = followed(times, failing)
        left = np.mean(passed[-10:, 0] - samples[len(passed) - 10 : len(passed), 0])
        z.append(left / np.sqrt(states[-1].variance[0]))
    assert np.mean(np.square(z)) < 2.0
    assert np.max(np.abs(z)) < 4.0


def test_a_hit_between_two_samples_is_no_drift() -> None:
    times, samples = encoders(3, 3.0)
    samples[times > 1.0, 2] += 0.6 * CONFIG.jump
    passed, states = followed(times, samples)
    assert_array_equal(passed, samples[: len(passed)])
    assert not any(state.fault for state in states)


@pytest.mark.parametrize(("left", "expected"), [(0.05, 0.0), (0.0, 0.05)])
def test_after_a_pause_an_offset_stays_or_goes_as_the_reading_says(
    left: float, expected: float
) -> None:
    times, samples = encoders(4, 4.0)
    samples[times > 1.0, 0] += 0.05
    samples[times > 2.0, 0] -= left
    heard = (times < 1.8) | (times > 2.2)
    state: AngleOffsets | None = None
    for part in (heard & (times < 2.0), heard & (times > 2.0)):
        _, state = follow_rates(times[part], samples[part], state, CONFIG)
    assert state is not None
    assert_allclose(state.offset[0], expected, atol=1e-3)


def test_what_was_remembered_is_not_changed() -> None:
    times, samples = encoders(5, 0.2)
    _, before = follow_rates(times[:20], samples[:20], None, CONFIG)
    assert before is not None
    unexplained = before.unexplained.copy()
    follow_rates(times[20:], samples[20:] + 1.0, before, CONFIG)
    assert_array_equal(before.unexplained, unexplained)
