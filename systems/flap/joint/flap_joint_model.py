"""What the joint filters know of a flap: the poses that they take, and what is read from them.

The flap's frame B has its origin at the contact and the world's axes when the flap is first
touched. A plane gives two of its rotations, the contact its position. The third rotation follows
from the least one that turns the first normal into this: the axis lies in the flap.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.depth_camera import DepthCamera, angle_variance
from crossmodal.systems.flap.flap_geometry import (
    CAMERA,
    FINGER,
    HOLDER,
    HingeLimitsConfig,
    angle_about,
    is_believed,
    turned_normal,
)
from crossmodal.systems.flap.hinge.hinge_keyframes import Keyframe
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersState
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_HINGE,
    DisplacementBelief,
    FingertipContact,
    FlapAngleBelief,
    HingeBelief,
    JointModelBelief,
    JointType,
    displacement_at,
)
from crossmodal.systems.ticks import Ticked


class FlapPose(NamedTuple):
    """A measured pose.

    Attributes:
        X_WB: (4, 4).
        covariance: (6, 6), in B, rotation first.
        correlated: Its part (6, 6) that stays for seconds: the contact wanders on the flap, the
            rotation about the normal has the constant error of the first normal, and a normal has
            a correlated error of its own.
    """

    X_WB: Array
    covariance: Array
    correlated: Array


def least_rotation(a: Array, b: Array) -> Array:
    """The rotation (3, 3) by the least angle that turns the unit vector a (3,) into b."""
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return np.asarray(se3.so3_exp(axis * (np.arctan2(sine, a @ b) / sine)))


def flap_pose(
    n0_W: Array,
    n_W: Array,
    n_covariance: Array,
    correlated_n: Array,
    contact: FingertipContact,
    contact_spread: float,
    twist: float,
) -> FlapPose:
    """The pose that goes with a normal and a contact.

    Args:
        n0_W: The front's normal (3,) when the flap was touched first.
        n_W: That at this tick (3,).
        n_covariance: (3, 3), new at every tick; wide where it was not seen.
        correlated_n: (3, 3), the part of its error that stays for seconds.
        contact: Where the flap is touched.
        contact_spread: Standard deviation of where on the flap that is, [m].
        twist: Standard deviation of the rotation about the normal, [rad].
    """
    R = least_rotation(n0_W, n_W)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, contact.p_WC
    S = se3.skew(n_W)  # dn = omega x n, so that omega = n x dn but for the part about n.
    about_n = twist**2 * np.outer(n_W, n_W)
    stays = S @ correlated_n @ S.T + about_n
    rotation = S @ n_covariance @ S.T + stays
    spread = contact_spread**2 * np.eye(3)
    white = contact.p_WC_white_covariance + spread
    zero = np.zeros((3, 3))
    return FlapPose(
        X,
        np.block([[R.T @ rotation @ R, zero], [zero, R.T @ white @ R]]),
        np.block([[R.T @ stays @ R, zero], [zero, spread]]),
    )


def without_position(pose: FlapPose) -> FlapPose:
    """The pose of a flap that is seen but not touched: its position's variance is infinite."""
    covariance, correlated = np.diag(np.full(6, np.inf)), np.zeros((6, 6))
    covariance[:3, :3] = pose.covariance[:3, :3]
    correlated[:3, :3] = pose.correlated[:3, :3]
    return FlapPose(pose.X_WB, covariance, correlated)


def _filters() -> JointFiltersConfig:
    return JointFiltersConfig(
        radius=0.1,
        axis_distance=0.1,
        type_priors=TypePriorsConfig(screw=0.02, rigid=0.4),
        ranking_priors=TypePriorsConfig(screw=0.02, rigid=0.4),
        errors=MeasurementErrorsConfig(declared_time=3.0),
    )


@dataclass(kw_only=True)
class FlapJointConfig(Ticked):
    """Configuration of `FlapJoint`."""

    filters: JointFiltersConfig = field(default_factory=_filters)
    # How far the contact wanders on the flap, across its edge and radially.
    contact_spread: float = number(0.002, at_least=1e-6, at_most=1.0, unit="m")
    # Rotation about the normal: the axis lies in the flap, but for what its first normal errs.
    twist: float = number(0.02, at_least=1e-6, at_most=10.0, unit="rad")
    # Direction of a normal that is not seen.
    unseen_normal: float = number(0.5, at_least=1e-6, at_most=10.0, unit="rad")
    # Error of a normal that stays for seconds: faces are not flat.
    flatness: float = number(1e-3, at_least=0.0, at_most=1.0, unit="rad")
    # A flap that nobody touches has moved once its normal is off by so many standard deviations.
    gate: float = number(3.0, above=0.0, at_most=100.0)
    # Images whose average is the reference, from the first touch on.
    reference_images: int = number(15, at_least=1, at_most=1000)
    # Path of the contact after which no more of them are waited for.
    at_rest: float = number(0.002, at_least=0.0, at_most=1.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class FlapJointState(Immutable):
    """What is known at one tick.

    Attributes:
        displacements: Of camera, holder and finger about the first contact, as they were known
            then, by which all is corrected; None before.
        rest: What was seen of the flap before it was touched first, since it last moved; None if
            nothing was.
        reference: What was seen and touched at first; None before.
        moved: How far what is touched has moved since (3,), while the reference grows, [m].
        reference_moved: Mean of that over the reference (3,), [m].
        filters: None before the reference is complete.
        n_W: Normal (3,) of the front that was seen last.
        n0_W: Normal (3,) of the front at the reference.
        n0_noise: (3, 3), of the images that it is the mean of.
        model: Of the revolute joint at this tick; None before.
        sign: 1 or -1: of the joint's axis for a positive angle.
        p_WC: Last contact (3,), [m].
        measured: Whether the flap was seen at this tick.
    """

    displacements: DisplacementBelief | None = None
    rest: Keyframe | None = None
    reference: Keyframe | None = None
    moved: Array = field(default_factory=lambda: np.zeros(3))
    reference_moved: Array = field(default_factory=lambda: np.zeros(3))
    filters: JointFiltersState | None = None
    n_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_noise: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    model: JointModelBelief | None = None
    sign: float = 1.0
    p_WC: Array = field(default_factory=lambda: np.full(3, np.nan))
    measured: bool = False


class FlapJointModel:
    """What of a `FlapJoint` stays as it is.

    Args:
        camera: Whose planes these are, as it is calibrated; it is assumed to stand still.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self, config: FlapJointConfig, limits: HingeLimitsConfig, camera: DepthCamera
    ) -> None:
        check(config, "FlapJoint")
        check(limits, "FlapJoint")
        self.config, self.limits, self.camera = config, limits, camera
        self.filters = JointFilters(config.filters, owner="FlapJoint")

    def now(self, state: JointFiltersState, time: float) -> JointModelBelief:
        """The revolute joint at a time [s]."""
        return self.filters.belief(state, time).models[JointType.REVOLUTE]

    def is_axis_known(self, model: JointModelBelief) -> bool:
        """Whether the axis is known well enough to turn a normal about it."""
        limit = self.limits.largest_direction**2
        return bool(np.trace(model.axis_covariance) < limit)  # NaN is not.


def expected_normal(state: FlapJointState, m: JointModelBelief, model: FlapJointModel) -> Array:
    """The front's normal (3,) by the joint; the one that was seen last while it has no axis."""
    if not model.is_axis_known(m):
        return state.n_W
    return turned_normal(m.axis_P, state.n0_W, float(m.configuration[0]))


def angle_at_reference(
    state: FlapJointState, k: Array, p_PA: Array, config: FlapJointConfig
) -> tuple[float, float]:
    """How far the flap was turned in the mean of the reference's images, and its variance.

    It is the angle from where it was seen before the first touch: what yields to less than is
    sensed has turned already. Of a flap that was not seen then, what is touched has moved since
    it was touched first, and the finger may have slipped on it meanwhile. Of the angle that the
    filters count from there, the reference's noise is an error, too.
    """
    reference, rest = state.reference, state.rest
    assert reference is not None
    along_0 = np.cross(k, state.n0_W)
    variance = float(along_0 @ state.n0_noise @ along_0)
    if rest is not None:
        n_W, noise = without_camera(rest.n_W, state.displacements), mean_noise(rest)
        return angle_about(k, n_W, state.n0_W), variance + float(along_0 @ noise @ along_0)
    u = reference.p_WC - p_PA
    u = u - k * (k @ u)
    along = np.cross(k, u) / (u @ u)
    time = 0.5 * reference.ticks * config.period / config.filters.errors.declared_time
    slip = 2.0 * config.contact_spread**2 * (1.0 - np.exp(-time))
    touched = reference.p_WC_covariance / reference.ticks + slip * np.eye(3)
    return float(along @ state.reference_moved), variance + float(along @ touched @ along)


def mean_noise(frame: Keyframe) -> Array:
    """Covariance (3, 3) of a keyframe's normal by the noise of its images."""
    return np.asarray(frame.plane_covariance[:3, :3] / frame.ticks)


def without_camera(n_W: Array, displacements: DisplacementBelief | None) -> Array:
    """A seen normal (3,) without what is known of the camera's displacement."""
    if displacements is None:
        return n_W
    n = n_W - np.cross(displacements.of(CAMERA)[0][:3], n_W)
    return np.asarray(n / np.linalg.norm(n))


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
