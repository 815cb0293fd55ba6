"""What sensors of a vector have in common: a fixed rate, a held sample, a window of samples."""

from abc import abstractmethod

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow

_TIME_TOLERANCE = 1e-9  # Far above rounding, far below a period, [s].


def latest_sample(time: float, period: float) -> int:
    """Number k of the last sample at or before `time` [s], samples being at k `period`."""
    return int(np.floor((time + _TIME_TOLERANCE) / period))


class SampledSensor(LeafSystem):
    """A sensor that samples a vector at a fixed rate and hands over the samples of a tick.

    The samples of the last tick lie in a ring in the Context. A reader at a sampling instant gets
    this instant's sample too, from the input: at the tick t the window holds the samples in
    (t - tick, t], also at t = 0, where it holds one.

    The update is an unrestricted one: at one instant Drake computes all of these before it applies
    any, the plant's step among them, whereas a discrete update would see the plant after its step.

    Input ports:
    - `(quantity)`: (n,), the true value.

    Output ports:
    - `(quantity)_measured`: (n,), the last stored sample; the first is stored when a simulation is
      initialized, so that nobody who reads at t = 0 gets zeros.
    - `(quantity)_window`: `SampleWindow` of (K,) stamps [s] and (K, n) samples.

    Subclasses say what one sample is by `measure`.
    """

    def __init__(self, quantity: str, output: str, size: int, period: float, tick: float) -> None:
        """Declares ports, state and event.

        Args:
            quantity: Name of the input port.
            output: Stem of the output ports' names.
            size: Length n of a sample.
            period: Between samples, [s].
            tick: Between the network's ticks, [s].

        Raises:
            ValueError: for ticks that come faster than samples.
        """
        super().__init__()
        if not period <= tick:
            raise ValueError(
                f"{type(self).__name__}: period = {period!r} s, need <= {tick:.3g} s, the tick"
            )
        self._size = size
        self._period = period
        self._tick = tick
        self._capacity = int(np.ceil(tick / period)) + 1
        self._input = self.DeclareVectorInputPort(quantity, size)
        self._ring = self.DeclareDiscreteState(self._capacity * size)
        self._latest = self.DeclareDiscreteState([-1.0])
        self.DeclareVectorOutputPort(
            f"{output}_measured",
            size,
            self._calc_measured,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclareAbstractOutputPort(
            f"{output}_window",
            lambda: AbstractValue.Make(SampleWindow(times=np.empty(0), values=np.empty((0, size)))),
            self._calc_window,
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._store)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._store)

    @abstractmethod
    def measure(self, value: Array, index: int) -> Array:
        """The sample (n,) of number `index` of the true `value` (n,)."""

    def _store(self, context: Context, state: State) -> None:
        index = latest_sample(context.get_time(), self._period)
        discrete = state.get_mutable_discrete_state()
        start = (index % self._capacity) * self._size
        sample = self.measure(self._input.Eval(context), index)
        if np.shape(sample) != (self._size,):
            raise ValueError(
                f"{type(self).__name__}.measure returned shape {np.shape(sample)}, but"
                f" '{self._input.get_name()}' has ({self._size},)"
            )
        discrete.get_mutable_value(self._ring)[start : start + self._size] = sample
        discrete.get_mutable_value(self._latest)[0] = index

    def _calc_measured(self, context: Context, output: BasicVector) -> None:
        index = int(context.get_discrete_state(self._latest).value()[0])
        ring = context.get_discrete_state(self._ring).value()
        start = (index % self._capacity) * self._size
        output.set_value(ring[start : start + self._size])

    def _calc_window(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        stored = int(context.get_discrete_state(self._latest).value()[0])
        ring = context.get_discrete_state(self._ring).value().reshape(self._capacity, self._size)
        first = max(0, latest_sample(time - self._tick, self._period) + 1)
        indices = np.arange(first, stored + 1)
        values = ring[indices % self._capacity]
        now = latest_sample(time, self._period)
        if now > stored and abs(now * self._period - time) < _TIME_TOLERANCE:
            indices = np.append(indices, now)
            values = np.vstack([values, self.measure(self._input.Eval(context), now)])
        times = np.asarray(indices * self._period)
        output.set_value(SampleWindow(times=times, values=values))
