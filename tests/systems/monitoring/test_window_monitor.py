"""Which samples a monitor passes on, and what it says of the stream."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.angles import AnglesByRates, AnglesConfig
from crossmodal.systems.monitoring.offsets import OFFSET
from crossmodal.systems.monitoring.steps import IsolatedSteps, StepsConfig
from crossmodal.systems.monitoring.window_monitor import (
    NO_SAMPLES,
    NOT_FINITE,
    OUT_OF_TIME,
    STUCK,
    Monitored,
    WindowMonitor,
    WindowMonitorConfig,
    check_window,
)
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.shared_settings import with_shared

TICK, STEP = 0.1, 0.01
CONFIG = with_shared(WindowMonitorConfig(), period=TICK)


def window(tick: int, *, offset: float = 0.0) -> SampleWindow:
    """Ten noisy samples in (tick - 1, tick]."""
    times = TICK * tick - STEP * np.arange(9, -1, -1) + offset
    rng = np.random.default_rng(tick)
    return SampleWindow(times=times, values=rng.normal(size=(10, 2)))


def monitored(windows: list[SampleWindow], model: IsolatedSteps | None = None) -> list[Monitored]:
    """The windows of the ticks 1, 2, ... through the system's ports."""
    system = WindowMonitor(CONFIG, 2, model)
    context = system.CreateDefaultContext()
    states = []
    for tick, value in enumerate(windows, start=1):
        context.SetTime(tick * TICK)
        system.GetInputPort("window").FixValue(context, AbstractValue.Make(value))
        passed = system.GetOutputPort("window_checked").Eval(context)
        system.ExecuteForcedEvents(context)
        health = system.GetOutputPort("health_latest").Eval(context)
        states.append(Monitored(passed=passed, health=health))
    return states


def faults(states: list[Monitored]) -> list[str]:
    return [state.health.fault for state in states]


def passed(state: Monitored) -> Array:
    assert state.passed is not None
    return state.passed.times


def test_a_healthy_stream_passes_as_it_is() -> None:
    windows = [window(k) for k in range(1, 6)]
    for state, measured in zip(monitored(windows), windows, strict=True):
        assert state.passed is not None
        assert_array_equal(state.passed.times, measured.times)
        assert_array_equal(state.passed.values, measured.values)
        assert state.health.fault == ""
        assert_allclose(state.health.age, 0.0, atol=1e-12)


def test_angles_that_jump_against_their_rates_pass_as_if_they_had_not() -> None:
    times = np.arange(1, 81) * STEP / 2.0
    angle = 0.3 * np.sin(2.0 * times)
    true = angle.copy()
    angle[(times > 0.15) & (times < 0.25)] += 0.05
    rate = 0.6 * np.cos(2.0 * times) + 1e-3 * np.random.default_rng(0).normal(size=80)
    system = WindowMonitor(CONFIG, 2, AnglesByRates(AnglesConfig()))
    context = system.CreateDefaultContext()
    kept, told, variances = [], [], []
    for tick in range(1, 5):
        mine = (times > TICK * (tick - 1) + 1e-9) & (times <= TICK * tick + 1e-9)
        values = np.column_stack([angle, rate])[mine]
        value = AbstractValue.Make(SampleWindow(times=times[mine], values=values))
        context.SetTime(tick * TICK)
        system.GetInputPort("window").FixValue(context, value)
        window = system.GetOutputPort("window_checked").Eval(context)
        kept += window.values[:, 0].tolist()
        variances.append(float(window.variances[0]))
        system.ExecuteForcedEvents(context)
        told.append(system.GetOutputPort("health_latest").Eval(context).fault)
    assert told == ["", OFFSET, "", ""]  # As it is at the end of the tick.
    assert_allclose(kept, true, atol=1e-3)
    assert [variance > 0.0 for variance in variances] == [False, True, False, False]


def test_an_offset_that_stays_is_told_as_long_as_samples_come() -> None:
    windows = [window(k) for k in range(1, 7)]
    for late in windows[1:]:
        late.values[:, 1] += 100.0
    windows[4] = windows[5] = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
    steps = IsolatedSteps(StepsConfig(), np.ones(2))
    states = monitored(windows, model=steps)
    assert faults(states) == ["", OFFSET, OFFSET, OFFSET, OFFSET, NO_SAMPLES]
    for state, measured in zip(states[2:4], windows[2:4], strict=True):
        assert state.passed is not None
        assert_allclose(state.passed.values, measured.values - [0.0, 100.0], atol=5.0)


def test_a_fast_reading_whose_samples_are_held_by_another_clock_does_not_jump() -> None:
    """An angle at 3 rad/s that a drive renews every 6 ms is read every 5 ms."""
    stamps = 0.2 + 0.005 * np.arange(1, 14)
    renewed = 0.006 * np.floor(stamps / 0.006 + 1e-9)
    window = SampleWindow(
        times=stamps, values=np.column_stack([3.0 * renewed, np.full(len(stamps), 3.0)])
    )
    before = Monitored(last_time=0.2)
    checked = check_window(window, before, stamps[-1], CONFIG, AnglesByRates(AnglesConfig()))
    assert checked.health.fault == ""
    assert checked.passed is not None
    assert len(checked.passed.times) == len(stamps)


def test_after_a_silence_a_reading_may_be_anywhere() -> None:
    empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
    before, after = (
        SampleWindow(times=TICK * np.array([tick]), values=np.array([[0.2 * tick, 0.0]]))
        for tick in (1, 4)
    )
    state = Monitored()
    for tick, value in enumerate([before, empty, empty, after], start=1):
        state = check_window(value, state, tick * TICK, CONFIG, AnglesByRates(AnglesConfig()))
    assert len(passed(state)) == 1


def test_a_silent_stream_grows_old_and_is_told_to_be_silent() -> None:
    empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
    states = monitored([window(1), empty, empty, window(4)])
    assert_allclose([state.health.age for state in states], [0.0, 0.1, 0.2, 0.0], atol=1e-12)
    assert faults(states) == ["", "", NO_SAMPLES, ""]


def test_a_stream_that_never_began_is_told() -> None:
    empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
    assert faults(monitored([empty] * 3)) == ["", NO_SAMPLES, NO_SAMPLES]


def test_what_is_no_number_is_left_out_and_the_rest_passes() -> None:
    holed = window(2)
    holed.values[4, 1] = np.nan
    states = monitored([window(1), holed])
    assert faults(states) == ["", NOT_FINITE]
    assert_array_equal(passed(states[1]), np.delete(holed.times, 4))


@pytest.mark.parametrize("offset", [3.0, -3.0])
def test_stamps_of_another_time_are_left_out_until_the_clock_is_right_again(offset: float) -> None:
    states = monitored([window(1), window(2, offset=offset), window(3)])
    assert faults(states) == ["", OUT_OF_TIME, ""]
    assert len(passed(states[1])) == 0
    assert len(passed(states[2])) == 10


def test_samples_that_come_a_little_late_pass() -> None:
    states = monitored([window(k, offset=-0.04) for k in range(1, 4)])
    assert faults(states) == ["", "", ""]
    assert [len(passed(state)) for state in states] == [10, 10, 10]


def test_a_stamp_does_not_pass_twice() -> None:
    states = monitored([window(1), window(1)])
    assert faults(states) == ["", OUT_OF_TIME]
    assert len(passed(states[1])) == 0


def test_a_sensor_that_is_stuck_is_found_within_a_tick() -> None:
    stuck = [SampleWindow(times=window(k).times, values=np.ones((10, 2))) for k in (2, 3)]
    states = monitored([window(1), *stuck, window(4)])
    assert faults(states) == ["", STUCK, STUCK, ""]
    # As many as a sensor that works may repeat.
    assert len(passed(states[1])) == round(CONFIG.stuck_after / STEP) + 1
    assert len(passed(states[2])) == 0


def test_a_reading_that_repeats_now_and_then_is_no_fault() -> None:
    repeated = window(2)
    repeated.values[3] = repeated.values[2]
    assert faults(monitored([window(1), repeated, window(3)])) == ["", "", ""]


def test_what_was_remembered_is_not_changed() -> None:
    before = check_window(window(1), Monitored(), TICK, CONFIG)
    reading = np.array(before.last_reading)
    check_window(window(2), before, 2 * TICK, CONFIG)
    assert_array_equal(before.last_reading, reading)


@pytest.mark.parametrize("field", ["oldest", "stuck_after", "stale_after"])
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0])
def test_impossible_limits_are_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        WindowMonitor(WindowMonitorConfig(**{field: value}), 2)
