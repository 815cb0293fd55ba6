"""What is known of a pair's joint by each model, as arrays."""

from typing import NamedTuple

import numpy as np

from maths.arrays import Array

AXIS_SPREAD = 1.2  # Deviation per direction of an axis anywhere on the sphere, [rad].


class Models(NamedTuple):
    """Beliefs of the moving and rigid models; the first index is the model.

    Attributes:
        Y: (3, 4, 4) X_FB at the reference.
        a: (3, 3) axis in F.
        c: (3, 3) axis point in F, [m].
        q: (3, K) configuration at each keyframe.
        inlier: (4, K) probability that a keyframe is no outlier, by each model, the free walk
            last; of open keyframes.
        signed: (3,) one where the sign of q is decided, else zero.
        prior_information: (3, 12, 12) of marginalised keyframes about (Y, a, c), a and c in three
            dimensions each, relative to where it was linearised.
        prior_vector: (3, 12) its information vector.
        prior_value: (3,) its log likelihood there.
        prior_Y: (3, 4, 4), prior_a: (3, 3), prior_c: (3, 3) where it was linearised.
        covariance: (3, 10, 10) of theta, after all keyframes.
        state: (3, 2) q and its rate at the newest keyframe.
        gain: (3, 2, 10) derivative of the state by theta.
        P: (3, 2, 2) covariance of the state given theta.
        process_noise: (3,) the density S of the acceleration with which q is followed.
        log_evidence: (4,) of each model, the free walk last.
        marginal_evidence: (4,) log evidence that marginalised keyframes have left.
    """

    Y: Array
    a: Array
    c: Array
    q: Array
    inlier: Array
    signed: Array
    prior_information: Array
    prior_vector: Array
    prior_value: Array
    prior_Y: Array
    prior_a: Array
    prior_c: Array
    covariance: Array
    state: Array
    gain: Array
    P: Array
    process_noise: Array
    log_evidence: Array
    marginal_evidence: Array


def initial_models(capacity: int) -> Models:
    """Models before any measurement, for `capacity` keyframes."""
    pose = np.tile(np.eye(4), (3, 1, 1))
    axis = np.tile(np.array([0.0, 0.0, 1.0]), (3, 1))
    point = np.zeros((3, 3))
    return Models(
        Y=pose,
        a=axis,
        c=point,
        q=np.zeros((3, capacity)),
        inlier=np.ones((4, capacity)),
        signed=np.zeros(3),
        prior_information=np.zeros((3, 12, 12)),
        prior_vector=np.zeros((3, 12)),
        prior_value=np.zeros(3),
        prior_Y=pose.copy(),
        prior_a=axis.copy(),
        prior_c=point.copy(),
        covariance=np.zeros((3, 10, 10)),
        state=np.zeros((3, 2)),
        gain=np.zeros((3, 2, 10)),
        P=np.zeros((3, 2, 2)),
        process_noise=np.zeros(3),
        log_evidence=np.zeros(4),
        marginal_evidence=np.zeros(4),
    )
