"""Angles that do not go where their rates, measured apart, lead.

A cable that slips makes them jump, a part that fails lets them drift. What an angle changes by more
than its rate's integral is noise, as long as the encoder works. What exceeds noise is taken out: at
once where it comes from one sample to the next, else as soon as it shows over some ticks; while it
drifts the rates say where the joint is.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number
from crossmodal.systems.monitoring.offsets import DRIFTING, OFFSET, Offsets, without_gone
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.shared_settings import SensorNoise


@dataclass(kw_only=True)
class AnglesConfig:
    noise = SensorNoise()
    # Change of an angle at rest from one sample to the next that is a jump.
    jump: float = number(0.01, above=0.0, at_most=100.0, unit="rad")
    # A sample may be older or newer than its stamp by so much.
    jitter: float = number(0.01, at_least=0.0, at_most=60.0, unit="s")
    # Error of the rates' integral, as a share of the displacement.
    scale: float = number(2.0e-3, at_least=0.0, at_most=1.0)
    # Time over which a drift is looked for.
    span: float = number(1.0, at_least=0.05, at_most=60.0, unit="s")
    # Drift that is no noise, in standard deviations.
    gate: float = number(5.0, above=0.0, at_most=100.0)
    # Share of this limit below which a drift has ended.
    ended: float = number(0.5, above=0.0, at_most=1.0)
    # Pause after which nothing is known of the angles' displacement.
    patience: float = number(0.15, at_least=1e-3, at_most=3600.0, unit="s")


@dataclass(frozen=True, kw_only=True)
class TickEnd(Immutable):
    """A tick's angles against their rates, all (n,).

    Attributes:
        time: Its last stamp, [s].
        unexplained: Mean change that the rates do not explain, [rad].
        variance: Of what the rates explain, within the tick, [rad^2].
        displacement: Without direction, within the tick, [rad].
        timing: Error of the mean by samples that are older or newer than they seem, [rad].
    """

    time: float
    unexplained: Array
    variance: Array
    displacement: Array
    timing: Array


@dataclass(frozen=True, kw_only=True)
class AngleOffsets(Offsets):
    """What is remembered of n angles.

    Attributes:
        time: Last stamp, [s].
        sample: Last one (2 n,), as it was measured.
        unexplained: Change (n,) that the rates do not explain, without jumps, [rad].
        ends: The ticks of the last `span`.
        drifting: Which angles (n,) drift.
    """

    time: float
    sample: Array
    unexplained: Array
    ends: tuple[TickEnd, ...] = ()
    drifting: Mask


def begin(time: float, sample: Array, before: AngleOffsets | None) -> AngleOffsets:
    """What is remembered at a first sample (2 n,), or at one after a pause.

    Of two offsets, that of before and none, it keeps the one that leads nearer to where the joint
    would be.
    """
    n = len(sample) // 2
    zeros = np.zeros(n)
    offset, variance = zeros, zeros
    if before is not None:
        gap = time - before.time
        displacement = 0.5 * gap * (before.sample[n:] + sample[n:])
        change = sample[:n] - (before.sample[:n] - before.offset) - displacement
        stays = np.abs(change - before.offset) < np.abs(change)
        offset, variance = before.offset * stays, before.variance * stays
    return AngleOffsets(
        offset=offset,
        variance=variance,
        time=time,
        sample=sample,
        unexplained=zeros,
        drifting=np.zeros(n, bool),
    )


@dataclass(frozen=True, kw_only=True)
class Changes:
    """What changes from sample to sample, all (K, n).

    Attributes:
        jumps: [rad]
        rest: Other change that the rates do not explain, [rad].
        displacement: That the rates explain, [rad].
        timing: Most that it is off by, by the jitter, [rad].
        variance: Of the displacement, [rad^2].
    """

    jumps: Array
    rest: Array
    displacement: Array
    timing: Array
    variance: Array


def split_changes(
    times: Array, samples: Array, before: AngleOffsets, config: AnglesConfig
) -> Changes:
    """Splits what changes from sample to sample (K, 2 n).

    Between two samples the rate is anywhere between theirs; the angle changes by the mean. What is
    no jump and yet too much for noise is a hit between two samples: it counts as noise of its size.
    """
    n = samples.shape[1] // 2
    dt = np.diff(times, prepend=before.time)[:, None]
    every = np.concatenate([before.sample[None], samples])
    earlier, later = every[:-1, n:], every[1:, n:]
    displacement = 0.5 * (earlier + later) * dt
    timing = config.jitter * np.maximum(np.abs(earlier), np.abs(later))
    unexplained = np.diff(every[:, :n], axis=0) - displacement
    jumps = np.where(np.abs(unexplained) > config.jump + timing, unexplained, 0.0)
    rest = unexplained - jumps
    variance = np.maximum(config.noise.rate * dt, 0.5 * np.abs(later - earlier) * dt) ** 2
    is_hit = np.abs(rest) > config.gate * np.sqrt(2.0 * config.noise.angle**2 + variance)
    variance = variance + np.where(is_hit, rest**2, 0.0)
    return Changes(
        jumps=jumps,
        rest=rest,
        displacement=displacement,
        timing=timing,
        variance=variance,
    )


def end_of(end: float, unexplained: Array, changes: Changes) -> TickEnd:
    """A tick, whose samples' unexplained changes (K, n) have been summed up since the beginning.

    Errors of single stamps are bounded, so that over K samples they average like 1 / K.
    """
    return TickEnd(
        time=end,
        unexplained=unexplained.mean(axis=0),
        variance=changes.variance.sum(axis=0),
        displacement=np.abs(changes.displacement).sum(axis=0),
        timing=changes.timing.max(axis=0) / len(unexplained),
    )


def find_drift(ends: tuple[TickEnd, ...], config: AnglesConfig) -> tuple[Array, Array, Array]:
    """How much the angles have drifted to the last of the ticks, over what noise makes (n,).

    Of all the ticks that they may have drifted from, that from which it is most. Returns also their
    unexplained change (n,) by then, and the variance (n,) of what the rates explain since.
    """

    def each(name: str) -> Array:
        return np.array([getattr(tick, name) for tick in ends])

    def since(values: Array) -> Array:
        return np.cumsum(values[::-1], axis=0)[::-1]

    variance = since(each("variance")) + 2.0 * config.noise.angle**2
    timing = each("timing")
    usual = config.gate * np.sqrt(variance) + timing + timing[-1]
    usual = usual + config.scale * since(np.abs(each("displacement")))
    unexplained = each("unexplained")
    ratio = np.abs(unexplained[-1] - unexplained) / usual
    best = (ratio.argmax(axis=0), np.arange(ratio.shape[1]))
    return ratio[best], unexplained[best], variance[best]


def follow_rates(
    times: Array, samples: Array, before: AngleOffsets | None, config: AnglesConfig
) -> tuple[Array, AngleOffsets | None]:
    """The samples (K, 2 n) without their angles' offsets, and what is to be remembered.

    Args:
        times: Stamps (K,), increasing, [s].
        samples: (K, 2 n), angles and their rates.
        before: What was remembered; None before the first one.
        config: Of noise and gates.
    """
    if len(times) == 0:
        return samples, before
    if before is None or times[0] - before.time > config.patience:
        before = begin(float(times[0]), samples[0], before)
    n, end = samples.shape[1] // 2, float(times[-1])
    changes = split_changes(times, samples, before, config)
    unexplained = before.unexplained + np.cumsum(changes.rest, axis=0)
    recent = (old for old in before.ends if old.time > end - config.span)
    ends = (*recent, end_of(end, unexplained, changes))
    ratio, from_where, variance_since = find_drift(ends, config)
    drifting = ratio > np.where(before.drifting, config.ended, 1.0)

    # An error that is anywhere within the timing has a third of its square as variance.
    of_jumps = np.where(
        changes.jumps != 0.0, 2.0 * config.noise.angle**2 + changes.timing**2 / 3.0, 0.0
    )
    goes_on = drifting & before.drifting
    base = np.where(goes_on, before.unexplained, from_where)
    of_drift = np.where(goes_on, ends[-1].variance, variance_since)
    offset = before.offset + np.cumsum(changes.jumps, axis=0)
    offset = offset + np.where(drifting, unexplained - base, 0.0)
    variance = before.variance + np.cumsum(of_jumps, axis=0) + np.where(drifting, of_drift, 0.0)
    offset, variance = without_gone(offset, variance)

    corrected = np.hstack([samples[:, :n] - offset, samples[:, n:]])
    fault = DRIFTING if drifting.any() else OFFSET if offset[-1].any() else ""
    return corrected, AngleOffsets(
        offset=offset[-1].copy(),
        variance=variance[-1].copy(),
        fault=fault,
        time=end,
        sample=samples[-1].copy(),
        unexplained=unexplained[-1].copy(),
        ends=ends,
        drifting=drifting,
    )


class AnglesByRates:
    """An `OffsetModel` of samples whose second half are the rates of the first."""

    def __init__(self, config: AnglesConfig) -> None:
        self._config = config

    def take_out(
        self, window: SampleWindow, before: Offsets | None, joints: SampleWindow | None
    ) -> tuple[SampleWindow, Offsets | None]:
        """See `OffsetModel`."""
        known = before if isinstance(before, AngleOffsets) else None
        values, after = follow_rates(window.times, window.values, known, self._config)
        if after is None:
            return window, None
        variances = np.concatenate([after.variance, 0.0 * after.variance])
        return replace(window, values=values, variances=variances), after
