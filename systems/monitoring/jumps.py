"""Readings that jump where their rates say that they cannot have, as a slipping encoder's do."""

from dataclasses import dataclass

import numpy as np

from maths.arrays import Array, Mask
from maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class Continuity(Immutable):
    """The last sample (2 n,), readings and their rates, its stamp, and the sum of jumps (n,)."""

    time: float
    sample: Array
    offset: Array


def without_jumps(
    times: Array,
    samples: Array,
    before: Continuity | None,
    smallest: float,
    jitter: float,
    patience: float,
) -> tuple[Mask, Continuity | None]:
    """Which samples (K,) are where the first one and all smooth motion since have led.

    From sample to sample a reading changes by its mean rate; what it changes more by is a jump, and
    all later readings are off by it, until another one leads back.

    Args:
        times: Stamps (K,), increasing, [s].
        samples: (K, 2 n), readings and their rates.
        before: The last sample; None before the first one.
        smallest: Change of a reading at rest that is a jump.
        jitter: By so much a sample may be older or newer than its stamp says, [s].
        patience: Pause after which nothing is known of the readings' way, [s].

    Returns:
        Which samples are good, and what is to be remembered.
    """
    if len(times) == 0:
        return np.zeros(0, bool), before
    n = samples.shape[1] // 2
    if before is None or times[0] - before.time > patience:
        before = Continuity(time=times[0], sample=samples[0], offset=np.zeros(n))
    dt = np.diff(times, prepend=before.time)[:, None]
    all_samples = np.concatenate([before.sample[None], samples])
    rates = 0.5 * (all_samples[1:, n:] + all_samples[:-1, n:])
    unexplained = np.diff(all_samples[:, :n], axis=0) - rates * dt
    usual = smallest + jitter * np.abs(rates)
    jumps = np.where(np.abs(unexplained) > usual, unexplained, 0.0)
    offsets = before.offset + np.cumsum(jumps, axis=0)
    good = np.all(np.abs(offsets) <= usual, axis=1)
    return good, Continuity(
        time=float(times[-1]), sample=samples[-1].copy(), offset=offsets[-1].copy()
    )
