"""What a failing stream delivers, kind by kind, through its ports."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.sensors.stream_fault import FAULTS, FailingStream, StreamFault

PERIOD = 0.1
EMPTY = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))


def window(tick: int) -> SampleWindow:
    """Two samples, the second at the tick itself, that count on."""
    times = PERIOD * (tick - np.array([0.5, 0.0]))
    numbers = 2.0 * tick + np.array([0.0, 1.0])
    return SampleWindow(times=times, values=np.column_stack([numbers, -numbers]))


def depth(tick: int) -> StampedImage:
    """A pixel that counts the ticks in metres, and one without a return."""
    image = ImageDepth32F(2, 1)
    image.mutable_data[:, :, 0] = [[1.0 + tick, 0.0]]
    return StampedImage(time=tick * PERIOD, image=image)


def failing(kind: str, *size: float, start: float = 0.2, end: float = np.inf) -> StreamFault:
    return StreamFault(stream="s", kind=kind, start=start, end=end, size=list(size))


def run(faults: Sequence[StreamFault], values: Sequence[Any], seed: int = 0) -> list[Any]:
    """What is delivered at the ticks, of the values that were measured there."""
    model = EMPTY if isinstance(values[0], SampleWindow) else values[0]
    system = FailingStream(model, list(faults), PERIOD, seed)
    context = system.CreateDefaultContext()
    delivered = []
    for tick, value in enumerate(values):
        context.SetTime(tick * PERIOD)
        is_vector = isinstance(value, np.ndarray)
        fixed = value if is_vector else AbstractValue.Make(value)
        system.GetInputPort("measured").FixValue(context, fixed)
        found = system.get_output_port().Eval(context)
        is_image = isinstance(found, ImageRgba8U | ImageDepth32F | ImageGrey8U)
        delivered.append(found.data[0, :, 0].copy() if is_image else found)
        system.ExecuteForcedEvents(context)
    return delivered


def test_a_stream_is_silent_while_somebody_silences_it() -> None:
    system = FailingStream(EMPTY, [], PERIOD, 0)
    context = system.CreateDefaultContext()
    system.GetInputPort("measured").FixValue(context, AbstractValue.Make(window(1)))
    samples = []
    for silenced in (0.0, 1.0, 0.0):
        system.GetInputPort("silenced").FixValue(context, [silenced])
        samples.append(len(system.get_output_port().Eval(context).times))
    assert samples == [2, 0, 2]


def windows(fault: StreamFault, count: int = 6) -> list[SampleWindow]:
    return run([fault], [window(k) for k in range(count)])


def depths(fault: StreamFault, count: int = 6) -> Array:
    found = run([fault], [depth(k) for k in range(count)])
    return np.array([stamped.image.data[0, :, 0] for stamped in found])


def stamps(fault: StreamFault, count: int = 6) -> Array:
    return np.array([s.time for s in run([fault], [depth(k) for k in range(count)])]) / PERIOD


@pytest.mark.parametrize("kind", FAULTS)
def test_before_and_after_a_fault_everything_is_as_measured(kind: str) -> None:
    size = {"delayed": (0.1,), "dropped": (1.0,), "clock_jump": (3.0,)}
    sizes = size.get(kind, (1.0,) if kind in ("biased", "drifting") else ())
    delivered = windows(failing(kind, *sizes, end=0.4))
    for tick in (0, 1, 4, 5):
        assert_array_equal(delivered[tick].times, window(tick).times)
        assert_array_equal(delivered[tick].values, window(tick).values)
    assert not np.array_equal(delivered[3].values, window(3).values) or kind == "clock_jump"


def test_of_a_stream_that_is_off_no_sample_arrives_and_an_image_stays() -> None:
    assert [len(w.times) for w in windows(failing("silent"))] == [2, 2, 0, 0, 0, 0]
    assert_array_equal(depths(failing("silent", end=0.4))[:, 0], [1, 2, 2, 2, 5, 6])
    assert_allclose(stamps(failing("silent", end=0.4)), [0, 1, 1, 1, 4, 5])


def test_a_frozen_stream_says_the_same_again_with_its_old_stamps() -> None:
    delivered = windows(failing("frozen"))
    for later in delivered[2:]:
        assert_array_equal(later.times, window(1).times)
        assert_array_equal(later.values, window(1).values)


def test_a_stuck_sensor_repeats_its_last_reading_with_new_stamps() -> None:
    delivered = windows(failing("stuck"))
    assert_array_equal(delivered[4].times, window(4).times)
    assert_array_equal(delivered[4].values, window(1).values[[1, 1]])
    assert_array_equal(depths(failing("stuck"))[:, 0], [1, 2, 2, 2, 2, 2])
    assert_allclose(stamps(failing("stuck")), [0, 1, 2, 3, 4, 5])


def test_a_delayed_stream_brings_what_was_measured_the_delay_ago() -> None:
    delivered = windows(failing("delayed", 0.2, start=0.1))
    assert len(delivered[1].times) == 0  # Of before the beginning.
    for tick in (2, 3, 4, 5):
        assert_array_equal(delivered[tick].values, window(tick - 2).values)
        assert_array_equal(delivered[tick].times, window(tick - 2).times)
    assert_array_equal(depths(failing("delayed", 0.2))[:, 0], [1, 2, 1, 2, 3, 4])
    assert_allclose(stamps(failing("delayed", 0.2)), [0, 1, 0, 1, 2, 3])


def test_of_dropped_samples_a_share_is_lost_and_the_seed_says_which() -> None:
    measured = [window(k) for k in range(300)]
    fault = failing("dropped", 0.3)
    kept = [sum(len(w.times) for w in run([fault], measured, seed)) / 600 for seed in (1, 1, 2)]
    assert kept[0] == kept[1] != kept[2]
    assert_allclose(kept, 0.7, atol=0.06)


def test_nan_is_in_every_reading_but_not_in_the_stamps() -> None:
    delivered = windows(failing("nan"))[3]
    assert np.isnan(delivered.values).all()
    assert_array_equal(delivered.times, window(3).times)
    assert np.isnan(depths(failing("nan"))[3]).all()


def test_a_bias_is_added_for_each_component_or_for_all() -> None:
    assert_allclose(windows(failing("biased", 5.0))[3].values - window(3).values, 5.0)
    each = windows(failing("biased", 5.0, -1.0))[3].values - window(3).values
    assert_allclose(each, [[5.0, -1.0]] * 2)


def test_a_drift_grows_with_the_stamps_and_leaves_no_return_alone() -> None:
    delivered = windows(failing("drifting", 2.0))[5]
    drift = 2.0 * (delivered.times - 0.2)
    assert_allclose(delivered.values - window(5).values, np.column_stack([drift, drift]))
    assert_allclose(depths(failing("drifting", 2.0))[5], [6.0 + 2.0 * 0.3, 0.0])


def test_a_clock_that_jumps_moves_the_stamps_alone() -> None:
    delivered = windows(failing("clock_jump", 3.0))[4]
    assert_allclose(delivered.times, window(4).times + 3.0)
    assert_array_equal(delivered.values, window(4).values)
    assert_allclose(stamps(failing("clock_jump", 3.0)), [0, 1, 32, 33, 34, 35])
    assert_array_equal(depths(failing("clock_jump", 3.0))[:, 0], [1, 2, 3, 4, 5, 6])


def test_colours_stay_within_their_range() -> None:
    image = ImageRgba8U(1, 1)
    image.mutable_data[:] = 250
    assert run([failing("biased", 20.0, start=0.0)], [image])[0][0] == 255


def test_a_vector_fails_too() -> None:
    values = [np.array([1.0 * k]) for k in range(5)]
    delivered = np.array(run([failing("silent", end=0.4)], values))
    assert_array_equal(delivered[:, 0], [0, 1, 1, 1, 4])


def test_faults_of_a_stream_act_one_after_another() -> None:
    faults = [failing("biased", 5.0), failing("stuck", start=0.4)]
    delivered = run(faults, [window(k) for k in range(6)])
    assert_array_equal(delivered[5].values, window(3).values[[1, 1]] + 5.0)


@pytest.mark.parametrize(
    ("fault", "model", "message"),
    [
        (failing("silen"), EMPTY, "there are silent, frozen"),
        (failing("silent", 1.0), EMPTY, "no number"),
        (failing("biased"), EMPTY, "1 number"),
        (failing("biased", 1.0, 2.0, 3.0), EMPTY, "2 number"),
        (failing("biased", np.nan), EMPTY, "size = "),
        (failing("delayed", -1.0), EMPTY, "> 0 s"),
        (failing("dropped", 1.5), EMPTY, "share"),
        (failing("silent", start=3.0, end=2.0), EMPTY, "start < end"),
        (failing("clock_jump", 1.0), ImageDepth32F(1, 1), "no stamps"),
        (failing("nan"), ImageGrey8U(1, 1), "whole numbers"),
    ],
)
def test_what_cannot_happen_to_a_stream_is_refused(
    fault: StreamFault, model: Any, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        FailingStream(model, [fault], PERIOD, 0)


@pytest.mark.parametrize("kind", FAULTS)
def test_the_name_of_a_fault_is_text_in_yaml(kind: str) -> None:
    assert yaml.safe_load(f"kind: {kind}") == {"kind": kind}
