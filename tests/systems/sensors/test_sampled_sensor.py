import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.sensors.sampled_sensor import SampledSensor, latest_sample

TICK = 1.0 / 15.0


class Clock(LeafSystem):
    """The time, twice; counted by an unrestricted update at every `step` to look like a plant."""

    def __init__(self, step=0.002):
        super().__init__()
        state = self.DeclareDiscreteState(2)
        self.DeclareStateOutputPort("time", state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(step, 0.0, self._advance)
        self._step = step

    def _advance(self, context, state):
        state.get_mutable_discrete_state().get_mutable_value(0)[:] = context.get_time() + self._step


class Echo(SampledSensor):
    """Measures without noise, and the number of the sample in its last element."""

    def __init__(self, period):
        super().__init__("signal", "echo", 2, period, TICK)

    def measure(self, value, index):
        return np.array([value[0], index])


class TickReader(LeafSystem):
    """Reads the window at every tick within an unrestricted update, as the filters do."""

    def __init__(self):
        super().__init__()
        self.ticks, self.windows = [], []
        model = SampleWindow(times=np.empty(0), values=np.empty((0, 2)))
        self._window = self.DeclareAbstractInputPort("window", AbstractValue.Make(model))
        self.DeclarePeriodicUnrestrictedUpdateEvent(TICK, 0.0, self._read)

    def _read(self, context, state):
        self.ticks.append(context.get_time())
        self.windows.append(self._window.Eval(context))


def simulate(period, duration=2.0):
    builder = DiagramBuilder()
    clock, sensor = builder.AddSystem(Clock()), builder.AddSystem(Echo(period))
    reader = builder.AddSystem(TickReader())
    builder.Connect(clock.get_output_port(), sensor.get_input_port())
    builder.Connect(sensor.GetOutputPort("echo_window"), reader.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(duration)
    return reader, sensor, sensor.GetMyContextFromRoot(simulator.get_context())


@pytest.mark.parametrize("period", [0.005, 0.01])
def test_windows_hold_every_sample_once_in_order(period):
    reader, _, _ = simulate(period)
    numbers = np.concatenate([window.values[:, 1] for window in reader.windows])
    np.testing.assert_array_equal(numbers, np.arange(len(numbers)))
    times = np.concatenate([window.times for window in reader.windows])
    np.testing.assert_allclose(times, period * np.arange(len(times)), atol=1e-12)
    assert len(times) == latest_sample(reader.ticks[-1], period) + 1


@pytest.mark.parametrize("period", [0.005, 0.01])
def test_a_window_reaches_from_after_the_last_tick_to_this_one(period):
    reader, _, _ = simulate(period)
    for tick, window in zip(reader.ticks, reader.windows, strict=True):
        assert window.times[0] > tick - TICK + 1e-9
        assert window.times[-1] <= tick + 1e-9
        assert tick - window.times[-1] < period


def test_samples_that_are_rarer_than_ticks_are_refused():
    with pytest.raises(ValueError, match=r"Echo: period = 0.1 s, need <= 0.0667 s, the tick"):
        Echo(0.1)


def test_the_first_window_holds_the_first_sample():
    reader, _, _ = simulate(0.005, duration=0.01)
    np.testing.assert_array_equal(reader.windows[0].times, [0.0])


def test_a_sample_is_what_the_plant_was_at_the_stamp_and_not_after_its_step():
    reader, _, _ = simulate(0.01)
    times = np.concatenate([window.times for window in reader.windows])
    values = np.concatenate([window.values[:, 0] for window in reader.windows])
    # The plant's 0.3 s and the sensor's differ by rounding, so that a few samples see one step on.
    late = np.abs(values - times) > 1e-9
    assert late.mean() < 0.2
    np.testing.assert_allclose(values[late], times[late] + 0.002, atol=1e-9)


def test_the_measured_output_holds_the_last_stored_sample():
    _, sensor, context = simulate(0.005, duration=0.1012)
    measured = sensor.GetOutputPort("echo_measured").Eval(context)
    np.testing.assert_allclose(measured, [0.1, 20], atol=1e-12)


def test_the_first_sample_is_there_as_soon_as_a_simulation_is_initialized():
    sensor = Echo(0.005)
    simulator = Simulator(sensor)
    sensor.get_input_port().FixValue(simulator.get_mutable_context(), [7.0, 7.0])
    simulator.Initialize()
    measured = sensor.GetOutputPort("echo_measured").Eval(simulator.get_context())
    np.testing.assert_array_equal(measured, [7.0, 0.0])


def test_the_measured_output_depends_on_the_state_alone():
    sensor = Echo(0.005)
    assert not sensor.HasDirectFeedthrough(sensor.GetOutputPort("echo_measured").get_index())
    assert sensor.HasDirectFeedthrough(sensor.GetOutputPort("echo_window").get_index())


@pytest.mark.parametrize("number", [0, 1, 2, 3, 7, 40, 123456])
@pytest.mark.parametrize("period", [0.005, 0.01, 1.0 / 30.0])
def test_a_sample_is_found_at_its_own_instant_despite_rounding(number, period):
    for time in (number * period, np.nextafter(number * period, np.inf)):
        assert latest_sample(time, period) == number
    if number:
        assert latest_sample(np.nextafter(number * period, 0.0), period) == number
    assert latest_sample((number + 0.5) * period, period) == number
