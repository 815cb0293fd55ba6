"""What taxels say while nothing presses them."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class TaxelTare(Immutable):
    """Offsets of T taxels, and which of them work.

    Attributes:
        offsets: Of their forces (3 T,), [N].
        works: Which taxels (T,) are trusted: one that works is never without noise.
        noise: Standard deviation of a component of those, [N].
    """

    offsets: Array
    works: Mask
    noise: float = 0.0

    def forces(self, measured: Array) -> Array:
        """Forces (T, 3) beyond the offsets, on taxels that work, [N].

        Args:
            measured: (3 T,), [N].
        """
        forces = (np.asarray(measured) - self.offsets).reshape(-1, 3)
        return np.where(self.works[:, None], forces, 0.0)


def no_tare(taxels: int) -> TaxelTare:
    """Before any has been taken: all taxels work and have no offset."""
    return TaxelTare(offsets=np.zeros(3 * taxels), works=np.ones(taxels, bool))


def tare(readings: Array) -> TaxelTare:
    """Of readings (K, 3 T) while nothing presses a taxel, [N]."""
    changed = np.any(readings[1:] != readings[:-1], axis=0)
    works: Mask = np.any(changed.reshape(-1, 3), axis=1)
    components = np.repeat(works, 3)
    spread = readings[:, components].std(axis=0)
    return TaxelTare(
        offsets=readings.mean(axis=0),
        works=works,
        noise=float(np.sqrt(np.mean(spread**2))) if len(spread) else 0.0,
    )
