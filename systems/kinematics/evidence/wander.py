"""Rotations of a tracker that err smoothly, by more than it reports.

A fiducial's rotation, or that of a model that a tracker fits, is off by degrees that change slowly
as the view changes, while two frames in a row differ by a tenth of that. Such errors do not average
out, and they turn a slide as a hinge does. Here they are a Gaussian process in time (the Matern
covariance of 5/2, of C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine
Learning", 2006, 4.2), in its principal components over the keyframes. Of a grid of sizes and times,
and none, the evidence decides. A body that no joint holds may turn as it likes, and has no need of
such errors.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.systems.kinematics.evidence.deviation_series import Waves, no_waves
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes

_LEAST = 1e-3  # Share of the variance below which a component is left out.
SIZES = tuple(float(x) for x in np.deg2rad((0.35, 0.7, 1.4, 2.8, 5.6)))
TIMES = (0.4, 0.8, 1.6, 3.2, 6.4, 12.8)  # [s].


class Wander(NamedTuple):
    """A size and a time, by their indices in `SIZES` and `TIMES`; the size is -1 for none."""

    at_size: int = -1
    at_time: int = 0

    @property
    def variance(self) -> float:
        """Per direction, [rad^2]."""
        return SIZES[self.at_size] ** 2 if self.at_size >= 0 else 0.0

    @property
    def log_prior(self) -> float:
        """Each size is half as common as the next smaller one; without the normaliser."""
        return -np.log(2.0) * max(self.at_size, 0)

    @property
    def neighbours(self) -> list["Wander"]:
        """Those beside it in the grid."""
        n, k = self
        beside = [Wander(n - 1, k), Wander(n + 1, k), Wander(n, k - 1), Wander(n, k + 1)]
        return [w for w in beside if 0 <= w[0] < len(SIZES) and 0 <= w[1] < len(TIMES)]


NONE = Wander()
GENEROUS = Wander(3, 2)  # From which others are looked for.
# All of them together are as common as so many of the smallest size.
COUNT = len(TIMES) * sum(2.0**-n for n in range(len(SIZES)))


def wander_waves(w: Wander, kf: Keyframes) -> Waves:
    """The errors at the keyframes."""
    n, capacity = int(kf.size[0]), kf.time.size
    if w == NONE:
        return no_waves(capacity)
    lag = np.sqrt(5.0) * np.abs(kf.time[:n, None] - kf.time[:n]) / TIMES[w.at_time]
    variance, components = np.linalg.eigh((1.0 + lag + lag**2 / 3.0) * np.exp(-lag))
    kept = variance > _LEAST
    value = np.zeros((capacity, 3 * int(kept.sum())))
    value[:n] = np.repeat(components[:, kept], 3, axis=1)
    return Waves(
        value=value,
        direction=np.tile(np.arange(3), int(kept.sum())),
        variance=w.variance * np.repeat(variance[kept], 3),
        along=np.ones(3 * int(kept.sum())),
    )
