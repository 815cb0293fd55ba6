"""Passes on the samples of a stream that can be true, and says how the stream does."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.monitoring.offsets import OffsetModel, Offsets
from crossmodal.systems.port_values import HEALTHY, SampleWindow, StreamHealth
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked

NO_SAMPLES = "no samples"
NOT_FINITE = "readings that are no numbers"
OUT_OF_TIME = "stamps that are not of now"
STUCK = "always the same reading"


@dataclass(kw_only=True)
class WindowMonitorConfig(Ticked):
    # A sample is passed on until it is so old.
    oldest: float = number(0.15, at_least=1e-3, at_most=3600.0, unit="s")
    # By so much a stamp may lie ahead of the tick.
    newest: float = number(0.005, at_least=0.0, at_most=3600.0, unit="s")
    # A noisy sensor does not read the same for so long; one that rounds its noise away does.
    stuck_after: float = number(0.05, at_least=1e-3, at_most=3600.0, unit="s", infinite=True)
    # Age of the last good sample that is a fault.
    stale_after: float = number(0.15, at_least=1e-3, at_most=3600.0, unit="s")


@dataclass(frozen=True, kw_only=True)
class Monitored(Immutable):
    """What a monitor remembers.

    Attributes:
        last_time: Last good stamp, [s].
        last_input: Last stamp, good or not, of a stream that holds its last value; None of others.
        last_reading: Last one (n,) that could be true but for its being always the same.
        same_since: Since when it is the same, [s].
        health: Of the stream.
        offsets: What is taken out of its readings.
        passed: The good samples of this tick.
    """

    last_time: float = -np.inf
    last_input: float | None = None
    last_reading: Array | None = None
    same_since: float = -np.inf
    health: StreamHealth = HEALTHY
    offsets: Offsets | None = None
    passed: SampleWindow | None = None


def repetition_starts(
    times: Array, values: Array, last_reading: Array | None, same_since: float
) -> Array:
    """Since when each of the samples (K, n) has been what it is (K,), [s]."""
    since = np.empty(len(times))
    previous, start = last_reading, same_since
    for k, (time, value) in enumerate(zip(times, values, strict=True)):
        if previous is None or not np.array_equal(value, previous):
            start = time
        since[k], previous = start, value
    return since


def check_window(
    window: SampleWindow,
    before: Monitored,
    now: float,
    config: WindowMonitorConfig,
    model: OffsetModel | None = None,
    joints: SampleWindow | None = None,
) -> Monitored:
    """The samples of a window that can be true, without what they are known to be off by.

    A sample is passed on if it is finite, stamped later than the last good one and neither too old
    nor ahead of `now`, and if the reading has not been the same for too long. Of several faults the
    first in this order is reported.

    Args:
        window: As it arrived.
        before: What was remembered.
        now: The tick, [s].
        config: Limits.
        model: How offsets are found; without it there are none.
        joints: Samples of the arm at the same time, if they are known.
    """
    times, values = window.times, window.values
    finite = np.isfinite(times) & np.isfinite(values).all(axis=1)
    timely = (times > now - config.oldest) & (times <= now + config.newest)
    timely &= times > np.maximum.accumulate(np.concatenate([[before.last_time], times]))[:-1]
    usable = finite & timely
    since = repetition_starts(times[usable], values[usable], before.last_reading, before.same_since)
    moving = times[usable] - since <= config.stuck_after
    good = np.flatnonzero(usable)[moving]
    passed, offsets = replace(window, times=times[good], values=values[good]), before.offsets
    if model is not None:
        passed, offsets = model.take_out(passed, offsets, joints)
    last = float(times[good[-1]]) if len(good) else before.last_time
    start = before.last_time if np.isfinite(before.last_time) else 0.0
    age = max(now - (last if np.isfinite(last) else start), 0.0)
    fault = ""
    if not finite.all():
        fault = NOT_FINITE
    elif not timely.all():
        fault = OUT_OF_TIME
    elif not moving.all():
        fault = STUCK
    elif age > config.stale_after:
        known = offsets is not None and before.health.fault == offsets.fault
        fault = NO_SAMPLES if known else before.health.fault or NO_SAMPLES
    elif offsets is not None:
        fault = offsets.fault
    inputs = np.flatnonzero(usable)
    return Monitored(
        last_time=last,
        last_reading=values[inputs[-1]].copy() if len(inputs) else before.last_reading,
        same_since=float(since[-1]) if len(inputs) else before.same_since,
        health=StreamHealth(age=age, fault=fault),
        offsets=offsets,
        passed=passed,
    )


class WindowMonitor(RecursiveFilter):
    """Keeps back the samples of one stream that cannot be true, and reports why.

    Whoever reads the checked window needs to know of no fault: nothing true arrived, and what is
    not measured makes a filter less certain. Where an offset of the readings has been measured, the
    samples pass without it, and the window says how well it is known.

    Input ports:
    - `window`: `SampleWindow`, as it arrives.
    - `joint_state_window`: `SampleWindow` of the arm, (2 n,) positions [rad] and velocities
      [rad/s], checked; may stay unconnected.

    Output ports:
    - `window_checked`: `SampleWindow` of the samples that can be true, at this tick.
    - `health_latest`: `StreamHealth` as of the last tick.

    Args:
        config: Limits.
        size: Length n of a sample.
        model: How offsets are found; without it there are none.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self, config: WindowMonitorConfig, size: int, model: OffsetModel | None = None
    ) -> None:
        super().__init__()
        check(config, "WindowMonitor")
        self._config, self._model = config, model
        empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, size)))
        self._window = self._declare_value_input("window", empty)
        self._joints = self._declare_value_input("joint_state_window", empty)
        self._declare_recursion(Monitored(passed=empty), self._check, config.period)
        self._declare_estimated("window_checked", lambda state: state.passed)
        self._declare_latest("health_latest", lambda state: state.health)

    def _check(self, context: Context, before: Any) -> Monitored:
        window = self._read(self._window, context)
        joints = self._read_optional(self._joints, context)
        now = context.get_time()
        return check_window(window, before, now, self._config, self._model, joints)
