"""The flap's hinge and angle, read from what the joint filters know."""

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import angle_variance
from crossmodal.systems.flap.flap_geometry import CAMERA, FINGER, HOLDER
from crossmodal.systems.flap.hinge.hinge_limits import HingeLimitsConfig, is_believed
from crossmodal.systems.flap.joint.flap_joint_model import (
    FlapJointConfig,
    FlapJointModel,
    FlapJointState,
    expected_normal,
)
from crossmodal.systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_HINGE,
    FlapAngleBelief,
    HingeBelief,
    displacement_at,
)


def angle_at_reference(
    state: FlapJointState, k: Array, p_PA: Array, config: FlapJointConfig
) -> tuple[float, float]:
    """How far the flap was turned in the mean of the reference's images, and its variance.

    What is touched has moved since it was touched first, and the finger may have slipped on it
    meanwhile. Of the angle that the filters count from there, the reference's noise is an error,
    too.
    """
    reference = state.reference
    assert reference is not None
    u = reference.p_WC - p_PA
    u = u - k * (k @ u)
    along = np.cross(k, u) / (u @ u)
    along_0 = np.cross(k, state.n0_W)
    time = 0.5 * reference.ticks * config.period / config.filters.errors.declared_time
    slip = 2.0 * config.contact_spread**2 * (1.0 - np.exp(-time))
    noise = reference.p_WC_covariance / reference.ticks + slip * np.eye(3)
    variance = float(along @ noise @ along + along_0 @ state.n0_noise @ along_0)
    return float(along @ state.reference_moved), variance


def _turned(k: Array, covariance: Array) -> Array:
    """Covariance (3, 3) of a direction that is turned by small rotations of this covariance."""
    S = se3.skew(k)
    return np.asarray(S @ covariance @ S.T)


def read_joint_hinge(state: FlapJointState, limits: HingeLimitsConfig) -> HingeBelief:
    """The hinge, with the calibrations' errors: the axis as it is seen, its place as touched."""
    m, displacements = state.model, state.displacements
    if m is None or displacements is None or not abs(m.configuration[0]) > limits.least_turn:
        return UNKNOWN_HINGE
    k = state.sign * m.axis_P
    across = np.eye(3) - np.outer(k, k)
    along = float(k @ (state.p_WC - m.p_PA))
    p_WK = m.p_PA + k * along
    mean, P = displacements.of(CAMERA, FINGER, HOLDER)
    # The axis errs with the camera, its place against the finger, whose own error is opposite.
    J = np.zeros((18, 18))
    J[:3, :3] = se3.skew(k)
    J[3:6, 6:12] = -across @ displacement_at(p_WK, displacements.p_WQ)
    J[3:6, :3] = along * J[:3, :3]
    J[6:, 6:] = np.eye(12)
    joint = J @ P @ J.T
    joint[:3, :3] += m.axis_covariance
    joint[3:6, 3:6] += across @ m.p_PA_covariance @ across + along**2 * m.axis_covariance
    joint[3:6, :3] += along * m.axis_covariance
    joint[:3, 3:6] += along * m.axis_covariance
    if not is_believed(joint[:3, :3], joint[3:6, 3:6], limits):
        return UNKNOWN_HINGE
    return HingeBelief(
        known=True,
        k_W=k,
        p_WK=p_WK,
        covariance=joint[:6, :6],
        p_WQ=displacements.p_WQ,
        displacements=mean[6:],
        displacement_covariance=joint[:, 6:],
    )


def read_joint_angle(state: FlapJointState, model: FlapJointModel) -> FlapAngleBelief:
    """The angle, with a normal that is n0's turned about the axis."""
    m = state.model
    if m is None or state.displacements is None:
        return UNKNOWN_ANGLE
    angle, rate = state.sign * m.configuration
    n, is_known = expected_normal(state, m, model), model.is_axis_known(m)
    k = state.sign * m.axis_P if is_known else np.cross(state.n0_W, n)
    camera = state.displacements.of(CAMERA)[1][:3, :3]
    n0_covariance = state.n0_noise + _turned(state.n0_W, camera)
    variance = float(m.configuration_covariance[0, 0])
    variance += angle_variance(model.camera, k, state.n0_W, n, float(rate))
    covariance = n0_covariance + variance * (np.eye(3) - np.outer(n, n))
    if not is_known:
        variance += float(np.linalg.eigvalsh(state.n0_noise)[-1])
    else:
        along, along_0 = np.cross(k, n), np.cross(k, state.n0_W)
        spread = variance + float(along_0 @ n0_covariance @ along_0)
        tilt = m.axis_covariance + _turned(k, camera)
        covariance = spread * np.outer(along, along) + float(n @ tilt @ n) * np.outer(k, k)
        first, first_variance = angle_at_reference(state, k, m.p_PA, model.config)
        angle, variance = angle + first, variance + first_variance
    return FlapAngleBelief(
        known=True,
        theta=float(angle),
        variance=variance,
        rate=float(rate),
        n_W=n,
        n_covariance=covariance,
        measured=state.measured,
    )
