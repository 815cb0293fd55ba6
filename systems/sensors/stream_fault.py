"""Streams that fail from one instant to another, as cables, drivers and clocks make them fail."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number, numbers
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.sensors.randomness import make_generator

# What each kind of fault does to a stream; an image or a vector stays where no new one arrives.
FAULTS = {
    "silent": "nothing arrives any more",
    "frozen": "the last message arrives again and again",
    "stuck": "new stamps, but always the last reading",
    "delayed": "everything arrives `size` [s] later",
    "dropped": "a share `size` of the samples is lost",
    "nan": "every reading is NaN",
    "biased": "`size` is added, in the stream's unit",
    "drifting": "`size` is added per second",
    "clock_jump": "the stamps are `size` [s] ahead",
}
BY_HAND = "silenced"  # Input by which somebody else lets a stream fail.
_WITHOUT_SIZE = ("silent", "frozen", "stuck", "nan")
_HELD = ("silent", "frozen", "stuck")
_IMAGES = (ImageRgba8U, ImageDepth32F, ImageGrey8U)


@dataclass(kw_only=True)
class StreamFault:
    """One fault of one stream.

    Attributes:
        size: One number, or one for each component of a sample; see `FAULTS`.
    """

    stream: str = ""  # The port that fails, such as wrench_window.
    kind: str = "silent"  # One of `FAULTS`.
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    # When it ends, since the episode began.
    end: float = number(float("inf"), above=0.0, at_most=86400.0, unit="s", infinite=True)
    size: list[float] = numbers([], at_least=-1e9, at_most=1e9, shape=(range(0, 65),))


def check_fault(fault: StreamFault, model: Any) -> None:
    """Refuses what cannot happen to a stream.

    Args:
        fault: Of the stream.
        model: A value like the stream's.

    Raises:
        ValueError: naming the fault, its field and what is possible.
    """
    what = f"fault '{fault.kind}' of {fault.stream}"
    if fault.kind not in FAULTS:
        raise ValueError(f"{what}: there are {', '.join(FAULTS)}")
    check(fault, what)
    if not fault.start < fault.end:
        raise ValueError(f"{what}: from {fault.start:g} to {fault.end:g} s, need start < end")
    sizes = np.asarray(fault.size, dtype=float)
    wanted = 0 if fault.kind in _WITHOUT_SIZE else 1
    if fault.kind in ("biased", "drifting") and len(sizes) > 1:
        wanted = _components(model)
    if len(sizes) != wanted:
        raise ValueError(f"{what}: size = {fault.size}, need {wanted or 'no'} number(s)")
    if fault.kind == "delayed" and not 0 < sizes[0] <= 60:
        raise ValueError(f"{what}: size = {sizes[0]:g} s, need > 0 s and <= 60 s")
    if fault.kind == "dropped" and not 0 < sizes[0] <= 1:
        raise ValueError(f"{what}: size = {sizes[0]:g}, need a share > 0 and <= 1")
    if fault.kind == "clock_jump" and not isinstance(model, SampleWindow | StampedImage):
        raise ValueError(f"{what}: the stream has no stamps")
    image = model.image if isinstance(model, StampedImage) else model
    if fault.kind == "nan" and isinstance(image, ImageRgba8U | ImageGrey8U):
        raise ValueError(f"{what}: its pixels are whole numbers, which cannot be NaN")


def _components(model: Any) -> int:
    if isinstance(model, SampleWindow):
        return int(model.values.shape[1])
    return len(model) if isinstance(model, np.ndarray) else 1


def fail_window(
    fault: StreamFault,
    window: SampleWindow,
    delivered: SampleWindow,
    delayed: SampleWindow,
    rng: np.random.Generator,
) -> SampleWindow:
    """What a fault makes of a window of samples.

    Args:
        fault: Which holds now.
        window: The healthy one.
        delivered: What was delivered at the last tick at which something was.
        delayed: The healthy one of the delay ago.
        rng: For what is lost.
    """
    times, values = window.times, window.values
    if fault.kind == "silent":
        return SampleWindow(times=times[:0], values=values[:0])
    if fault.kind == "frozen":
        return delivered
    if fault.kind == "stuck":
        stuck = delivered.values[-1:] if len(delivered.values) else values[:1]
        return replace(window, values=np.repeat(stuck, len(times), axis=0))
    if fault.kind == "delayed":
        return delayed
    if fault.kind == "dropped":
        kept = rng.random(len(times)) >= fault.size[0]
        return SampleWindow(times=times[kept], values=values[kept])
    if fault.kind == "nan":
        return replace(window, values=np.full_like(values, np.nan))
    if fault.kind == "clock_jump":
        return replace(window, times=times + fault.size[0])
    lasted = times[:, None] - fault.start if fault.kind == "drifting" else 1.0
    return replace(window, values=values + lasted * np.asarray(fault.size))


def fail_array(
    fault: StreamFault,
    value: Array,
    delivered: Array,
    delayed: Array,
    time: float,
    rng: np.random.Generator,
) -> Array:
    """What a fault makes of an image (H, W, C) or a vector (n,), at the tick `time` [s].

    Depth that is no return stays so; whole numbers are rounded and stay within their range.
    """
    if fault.kind in _HELD:
        return delivered
    if fault.kind == "delayed":
        return delayed
    if fault.kind == "dropped":
        return delivered if rng.random() < fault.size[0] else value
    if fault.kind == "nan":
        return np.full_like(value, np.nan)
    lasted = time - fault.start if fault.kind == "drifting" else 1.0
    failed = value + lasted * np.asarray(fault.size)
    if value.dtype == np.uint8:
        failed = np.clip(np.rint(failed), 0, 255)
    elif value.ndim == 3:
        failed = np.where(value > 0.0, failed, value)
    return np.asarray(failed, dtype=value.dtype)


def fail_image(
    fault: StreamFault,
    taken: StampedImage,
    delivered: StampedImage,
    delayed: StampedImage,
    time: float,
    rng: np.random.Generator,
) -> StampedImage:
    """What a fault makes of a stamped image, at the tick `time` [s]; see `fail_array`."""
    if fault.kind in ("silent", "frozen"):
        return delivered
    if fault.kind == "stuck":
        return replace(taken, image=delivered.image)
    if fault.kind == "delayed":
        return delayed
    if fault.kind == "dropped":
        return delivered if rng.random() < fault.size[0] else taken
    if fault.kind == "clock_jump":
        return replace(taken, time=taken.time + fault.size[0])
    data = np.asarray(taken.image.data)
    return replace(
        taken, image=_image_of(taken.image, fail_array(fault, data, data, data, time, rng))
    )


def _image_of(kind: Any, values: Array) -> Any:
    """An image like another one, of values (H, W, C)."""
    image = type(kind)(values.shape[1], values.shape[0])
    image.mutable_data[:] = values
    return image


@dataclass(frozen=True)
class _Past(Immutable):
    """What was measured over the longest delay, by time, and what was delivered last."""

    measured: tuple[tuple[float, Any], ...] = ()
    delivered: Any = None


class FailingStream(LeafSystem):
    """Passes a stream on as its faults leave it.

    Input ports:
    - `measured`: of the model's type: a `SampleWindow`, an image, stamped or not, or a vector (n,).
    - `silenced`: (1,) above 0.5 while nothing arrives. May stay unconnected.

    Output ports:
    - `delivered`: of the same type. Read it at the ticks; while no fault holds it is the measured
      value.

    State: what was measured at the ticks of the longest delay, and what was delivered last.

    Args:
        model: A value like the stream's.
        faults: Of this stream, in the order in which they act.
        period: Of the ticks, [s].
        seed: Of what is lost.

    Raises:
        ValueError: for a fault that the stream cannot have.
    """

    def __init__(self, model: Any, faults: list[StreamFault], period: float, seed: int) -> None:
        super().__init__()
        for fault in faults:
            check_fault(fault, model)
        self._faults, self._period, self._seed = faults, period, seed
        self._plain_image = model if isinstance(model, _IMAGES) else None
        self._memory = max((f.size[0] for f in faults if f.kind == "delayed"), default=0.0)
        if isinstance(model, np.ndarray):
            self._input = self.DeclareVectorInputPort("measured", len(model))
        else:
            self._input = self.DeclareAbstractInputPort("measured", AbstractValue.Make(model))
        self._silenced = self.DeclareVectorInputPort(BY_HAND, 1)
        state = self.DeclareAbstractState(Value[object](_Past()))
        tickets = {
            self.input_port_ticket(self._input.get_index()),
            self.input_port_ticket(self._silenced.get_index()),
            self.abstract_state_ticket(state),
            self.time_ticket(),
        }
        if isinstance(model, np.ndarray):
            self.DeclareVectorOutputPort("delivered", len(model), self._write, tickets)
        else:
            self.DeclareAbstractOutputPort(
                "delivered", lambda: AbstractValue.Make(model), self._write, tickets
            )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._remember)
        self.DeclareForcedUnrestrictedUpdateEvent(self._remember)

    def _measured(self, context: Context) -> Any:
        value = self._input.Eval(context)
        return value.data if self._plain_image is not None else value

    def _delivered(self, context: Context) -> Any:
        """Of this tick: a window, a stamped image, or an array."""
        time, value = context.get_time(), self._measured(context)
        past: _Past = context.get_abstract_state(0).get_value()
        tick = round(time / self._period)
        faults = self._faults
        if self._silenced.HasValue(context) and self._silenced.Eval(context)[0] > 0.5:
            faults = [*faults, StreamFault(kind="silent")]
        for index, fault in enumerate(faults):
            if not fault.start - 1e-9 <= time < fault.end - 1e-9:
                continue
            rng = make_generator(self._seed, f"fault {index} of {fault.stream}", tick)
            if fault.kind == "delayed":
                delayed = self._measured_at(time - fault.size[0], past, value)
            else:
                delayed = value
            last = value if past.delivered is None else past.delivered
            if isinstance(value, SampleWindow):
                value = fail_window(fault, value, last, delayed, rng)
            elif isinstance(value, StampedImage):
                value = fail_image(fault, value, last, delayed, time, rng)
            else:
                value = fail_array(fault, value, last, delayed, time, rng)
        return value

    def _measured_at(self, time: float, past: _Past, now: Any) -> Any:
        """What had been measured by then; before the first tick nothing, or the first image."""
        known = [value for when, value in past.measured if when <= time + 1e-9]
        if known:
            return known[-1]
        first = past.measured[0][1] if past.measured else now
        if isinstance(first, SampleWindow):
            return SampleWindow(times=first.times[:0], values=first.values[:0])
        return first

    def _write(self, context: Context, output: Any) -> None:
        value = self._delivered(context)
        if self._plain_image is not None:
            value = _image_of(self._plain_image, value)
        output.set_value(value)

    def _remember(self, context: Context, state: State) -> None:
        past: _Past = context.get_abstract_state(0).get_value()
        time, value = context.get_time(), _copied(self._measured(context))
        since = time - self._memory - self._period
        measured = [(when, old) for when, old in past.measured if when >= since]
        delivered = _copied(self._delivered(context))
        if isinstance(delivered, SampleWindow) and not len(delivered.times):
            delivered = past.delivered
        state.get_mutable_abstract_state(0).set_value(
            _Past(measured=(*measured, (time, value)), delivered=delivered)
        )


def _copied(value: Any) -> Any:
    """Drake writes a port's next array over the last one; windows are made anew."""
    return value.copy() if isinstance(value, np.ndarray) else value
