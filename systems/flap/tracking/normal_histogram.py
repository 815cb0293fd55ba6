"""Surfaces of one orientation, by a histogram of normals.

The x and y components of all normals are counted in a histogram of 11 x 11 bins; its highest bins
are the surfaces' normals.

Source: D. Holz, S. Holzer, R. B. Rusu, S. Behnke, Real-Time Plane Segmentation using RGB-D Cameras,
RoboCup 2011; of the 11 x 11 bins, the paper that `flap_tracking` names.
"""

import numpy as np

from crossmodal.maths.arrays import Array, Ids

BINS = 11


def normal_histogram(normals_C: Array) -> Array:
    """Counts (11, 11) of the x (rows) and y components (columns) of unit normals (N, 3)."""
    bins = np.clip(((normals_C[:, :2] + 1.0) * (0.5 * BINS)).astype(int), 0, BINS - 1)
    counts = np.bincount(bins[:, 0] * BINS + bins[:, 1], minlength=BINS**2)
    return counts.reshape(BINS, BINS).astype(float)


def mean_normal(normals_C: Array) -> Array:
    """The direction (3,) of the sum of unit normals (N, 3)."""
    total = normals_C.sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def cluster_normals(
    normals_C: Array, radius: float, least_share: float, rounds: int = 3
) -> tuple[Array, Ids]:
    """At most two clusters of normals.

    The highest bin begins the first cluster; the highest one of what is farther from it than
    `radius` begins the second. Each normal then goes to the nearer mean, if that is within
    `radius`, as often as `rounds`.

    Args:
        normals_C: Unit normals (N, 3) towards the camera; N >= 1.
        radius: Of a cluster, [rad].
        least_share: Of all normals that a second cluster needs.

    Returns:
        Mean normals (K, 3), the larger cluster's first, and each normal's cluster (N,), -1 where
        it belongs to none.
    """
    means = [_seed(normals_C, radius)]
    rest = normals_C[normals_C @ means[0] < np.cos(radius)]
    if len(rest) >= least_share * len(normals_C):
        means.append(_seed(rest, radius))
    centres = np.array(means)
    label = _assign(normals_C, centres, radius)
    for _ in range(rounds):
        centres = np.array(
            [
                mean_normal(normals_C[label == k]) if np.any(label == k) else centres[k]
                for k in range(len(centres))
            ]
        )
        label = _assign(normals_C, centres, radius)
    counts = np.bincount(label[label >= 0], minlength=len(centres))
    order = [k for k in np.argsort(-counts) if counts[k] >= least_share * len(normals_C)]
    renumber = np.full(len(centres) + 1, -1)
    renumber[order] = np.arange(len(order))
    return centres[order], renumber[label]


def _seed(normals_C: Array, radius: float) -> Array:
    """The mean of the normals about the highest bin's."""
    counts = normal_histogram(normals_C)
    row, column = np.unravel_index(int(np.argmax(counts)), counts.shape)
    xy = (np.array([row, column]) + 0.5) * (2.0 / BINS) - 1.0
    near = np.linalg.norm(normals_C[:, :2] - xy, axis=1) < 2.0 / BINS
    mean = mean_normal(normals_C[near])
    return mean_normal(normals_C[normals_C @ mean > np.cos(radius)])


def _assign(normals_C: Array, centres: Array, radius: float) -> Ids:
    cosines = normals_C @ centres.T
    label = np.argmax(cosines, axis=1)
    label[cosines.max(axis=1) < np.cos(radius)] = -1
    return np.asarray(label)
