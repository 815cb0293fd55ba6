"""Point features of the image, located in the world."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Ids


@dataclass(kw_only=True)
class FeatureBelief:
    """N tracked point features; a feature keeps its id as long as it is tracked.

    Attributes:
        ids: (N,) unique, never used again.
        uv: Pixels (N, 2).
        p_WF: Positions in the world (N, 3), [m].
        covariance: Of the positions (N, 3, 3), [m^2], one frame's noise.
        age: Ticks since its initiation (N,).
    """

    ids: Ids
    uv: Array
    p_WF: Array
    covariance: Array
    age: Ids


def no_features() -> FeatureBelief:
    """The belief that nothing is tracked."""
    return FeatureBelief(
        ids=np.zeros(0, np.int64),
        uv=np.zeros((0, 2)),
        p_WF=np.zeros((0, 3)),
        covariance=np.zeros((0, 3, 3)),
        age=np.zeros(0, np.int64),
    )
