"""What is known of a pair's joint by each model, as arrays."""

from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.solver.joint_geometry import JOINTS, PARAMETERS

AXIS_SPREAD = 1.2  # Deviation per direction of an axis anywhere on the sphere, [rad].


class Models(NamedTuple):
    """Beliefs of the J moving and rigid models and a free motion; the first index is the model.

    N are the parameters of the largest model.

    Attributes:
        Y: (J, 4, 4) X_FB at the reference.
        a: (J, 3) axis in F.
        c: (J, 3) axis point in F, [m].
        pitch: (J,) [m/rad].
        q: (J, K) configuration at each keyframe.
        inlier: (J + 1, K) probability that a keyframe is no outlier, by each model, a free motion
            last; of undecided keyframes.
        signed: (J,) one where the sign of q is decided, else zero.
        prior_information: (J, N + 2, N + 2) of marginalised keyframes about (Y, a, c, pitch), a and
            c in three dimensions each, relative to where it was linearised.
        prior_vector: (J, N + 2) its information vector.
        prior_value: (J,) its log likelihood there.
        prior_Y: (J, 4, 4), prior_a: (J, 3), prior_c: (J, 3), prior_pitch: (J,) where it was
            linearised.
        covariance: (J, N, N) of theta, after all keyframes.
        state: (J, 2) q and its rate at the newest keyframe.
        gain: (J, 2, N) derivative of the state by theta.
        P: (J, 2, 2) covariance of the state given theta.
        process_noise: (J,) the density S of the acceleration with which q is followed.
        log_evidence: (J + 1,) of each model, a free motion last.
        marginal_evidence: (J + 1,) log evidence that marginalised keyframes have left.
    """

    Y: Array
    a: Array
    c: Array
    pitch: Array
    q: Array
    inlier: Array
    signed: Array
    prior_information: Array
    prior_vector: Array
    prior_value: Array
    prior_Y: Array
    prior_a: Array
    prior_c: Array
    prior_pitch: Array
    covariance: Array
    state: Array
    gain: Array
    P: Array
    process_noise: Array
    log_evidence: Array
    marginal_evidence: Array


@hot
def copy_models(m: Models) -> Models:
    """A copy that may be changed."""
    return Models(
        m.Y.copy(),
        m.a.copy(),
        m.c.copy(),
        m.pitch.copy(),
        m.q.copy(),
        m.inlier.copy(),
        m.signed.copy(),
        m.prior_information.copy(),
        m.prior_vector.copy(),
        m.prior_value.copy(),
        m.prior_Y.copy(),
        m.prior_a.copy(),
        m.prior_c.copy(),
        m.prior_pitch.copy(),
        m.covariance.copy(),
        m.state.copy(),
        m.gain.copy(),
        m.P.copy(),
        m.process_noise.copy(),
        m.log_evidence.copy(),
        m.marginal_evidence.copy(),
    )


@hot
def has_prior(kind: int, m: Models) -> bool:
    """Whether a model has a prior from marginalised keyframes or from before a constant error."""
    return bool(np.trace(m.prior_information[kind]) > 0.0)


def initial_models(capacity: int) -> Models:
    """Models before any measurement, for `capacity` keyframes."""
    pose = np.tile(np.eye(4), (JOINTS, 1, 1))
    axis = np.tile(np.array([0.0, 0.0, 1.0]), (JOINTS, 1))
    point = np.zeros((JOINTS, 3))
    extended = PARAMETERS + 2
    return Models(
        Y=pose,
        a=axis,
        c=point,
        pitch=np.zeros(JOINTS),
        q=np.zeros((JOINTS, capacity)),
        inlier=np.ones((JOINTS + 1, capacity)),
        signed=np.zeros(JOINTS),
        prior_information=np.zeros((JOINTS, extended, extended)),
        prior_vector=np.zeros((JOINTS, extended)),
        prior_value=np.zeros(JOINTS),
        prior_Y=pose.copy(),
        prior_a=axis.copy(),
        prior_c=point.copy(),
        prior_pitch=np.zeros(JOINTS),
        covariance=np.zeros((JOINTS, PARAMETERS, PARAMETERS)),
        state=np.zeros((JOINTS, 2)),
        gain=np.zeros((JOINTS, 2, PARAMETERS)),
        P=np.zeros((JOINTS, 2, 2)),
        process_noise=np.zeros(JOINTS),
        log_evidence=np.zeros(JOINTS + 1),
        marginal_evidence=np.zeros(JOINTS + 1),
    )
