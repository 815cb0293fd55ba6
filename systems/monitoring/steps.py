"""Readings that step from one sample to the next, and are quiet before and after.

Neither a force that a soft hand transmits nor the air in a chamber does that: what goes on smoothly
changes over several samples, however fast, and what hits shakes. On either side of each instant the
samples lie within some range; a ramp leads by 2.5 of these from one mean to the other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.monitoring.offsets import OFFSET, Offsets, without_gone
from crossmodal.systems.port_values import SampleWindow

_REMEMBERED = 0.25  # Of the joints' motion, [s].


@dataclass(kw_only=True)
class StepsConfig:
    # Samples on either side that must be quiet.
    samples: int = number(5, at_least=2, at_most=1000)
    # A step, in ranges of the samples on either side; three times that of a ramp.
    gate: float = number(8.0, above=2.5, at_most=1e6)
    # Least range, in standard deviations of the sensor's noise.
    noises: float = number(4.0, at_least=1.0, at_most=1e3)
    # Pause between two samples, in usual ones, within which anything may have happened.
    pause: float = number(1.5, above=1.0, at_most=1e3)


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step of readings by `size` (n,), with variances (n,).

    Attributes:
        since: Last stamp before it, [s].
        time: First stamp after it, [s].
    """

    since: float
    time: float
    size: Array
    variance: Array


@dataclass(frozen=True, kw_only=True)
class StepOffsets(Offsets):
    """What is remembered: the last samples as they were measured, and how the arm has moved."""

    last: SampleWindow
    joints: SampleWindow | None = None


def find_steps(times: Array, values: Array, noise: Array, config: StepsConfig) -> list[Step]:
    """The steps of samples (K, n) that have enough others on either side.

    Args:
        times: Stamps (K,), increasing, [s].
        values: (K, n)
        noise: Standard deviations of a sample (n,).
        config: Of what a step is.
    """
    M = config.samples
    if len(times) < 2 * M:
        return []
    pauses = sliding_window_view(np.diff(times), 2 * M - 1)
    usual = pauses.max(axis=1) <= config.pause * np.median(pauses, axis=1)
    sides = sliding_window_view(values, M, axis=0)  # (K - M + 1, n, M)
    means = sides.mean(axis=2)
    ranges = np.abs(sides - means[:, :, None]).max(axis=2)
    ranges = np.maximum(np.maximum(ranges[:-M], ranges[M:]), config.noises * noise)
    steps = usual & np.any(np.abs(means[M:] - means[:-M]) > config.gate * ranges, axis=1)
    return [measure_step(times, values, noise, int(k) + M, M) for k in np.flatnonzero(steps)]


def measure_step(times: Array, values: Array, noise: Array, k: int, samples: int) -> Step:
    """The step before the sample k, from so many samples on either side.

    It is what a straight line through all of these does not explain.
    """
    M = samples
    around = values[k - M : k + M]
    A = np.column_stack([np.ones(2 * M), np.arange(2 * M) >= M, np.arange(2 * M) - M + 0.5])
    fit = np.linalg.lstsq(A, around, rcond=None)[0]
    spread = np.sum((around - A @ fit) ** 2, axis=0) / (2 * M - 3)
    variance = np.maximum(spread, noise**2) * np.linalg.inv(A.T @ A)[1, 1]
    return Step(since=float(times[k - 1]), time=float(times[k]), size=fit[1], variance=variance)


def joined(before: SampleWindow | None, new: SampleWindow | None) -> SampleWindow | None:
    """The samples of two windows."""
    if before is None or new is None:
        return before if new is None else new
    return SampleWindow(
        times=np.concatenate([before.times, new.times]),
        values=np.concatenate([before.values, new.values]),
    )


def cut(window: SampleWindow, first: int) -> SampleWindow:
    """The samples of a window from one on."""
    return SampleWindow(times=window.times[first:].copy(), values=window.values[first:].copy())


class IsolatedSteps:
    """An `OffsetModel` of readings that do not step.

    Args:
        config: Of what a step is.
        noise: Standard deviations of a sample (n,).
        is_sensed: Whether the arm has moved as a step would move it; without it no step is real.
    """

    def __init__(
        self,
        config: StepsConfig,
        noise: Array,
        is_sensed: Callable[[Step, SampleWindow], bool] | None = None,
    ) -> None:
        self._config, self._noise, self._is_sensed = config, noise, is_sensed

    def take_out(
        self, window: SampleWindow, before: Offsets | None, joints: SampleWindow | None
    ) -> tuple[SampleWindow, Offsets | None]:
        """See `OffsetModel`."""
        zeros = np.zeros(len(self._noise))
        if not isinstance(before, StepOffsets):
            before = StepOffsets(offset=zeros, variance=zeros, last=cut(window, 0))
            every = window
        else:
            every = joined(before.last, window) or window
        motion = joined(before.joints, joints)
        offset, variance = before.offset, before.variance
        values = window.values - offset
        for step in find_steps(every.times, every.values, self._noise, self._config):
            if self._is_sensed is not None and (motion is None or self._is_sensed(step, motion)):
                continue
            after, variance = without_gone(offset + step.size, variance + step.variance)
            values = values - np.outer(window.times >= step.time, after - offset)
            offset = after
        kept = max(0, len(every.times) - 2 * self._config.samples + 1)
        if motion is not None and len(motion.times):
            recent = motion.times > motion.times[-1] - _REMEMBERED
            motion = cut(motion, int(np.argmax(recent)))
        return replace(window, values=values, variances=variance), StepOffsets(
            offset=offset,
            variance=variance,
            fault=OFFSET if offset.any() else "",
            last=cut(every, kept),
            joints=motion,
        )
