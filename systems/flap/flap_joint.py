"""The flap's hinge and angle by the joint filters that serve the cross-modal network, too."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from maths import se3
from maths.arrays import Array
from maths.immutable import Immutable
from maths.validation import check, number
from systems.depth_camera import DepthCamera, angle_variance, tilt_covariance
from systems.flap.displacements import CAMERA, FINGER, HOLDER, NAMES
from systems.flap.flap_angle import turned_normal
from systems.flap.flap_pose import flap_pose, without_position
from systems.flap.hinge_keyframes import Keyframe, begin, merge
from systems.flap.hinge_limits import HingeLimitsConfig, is_believed
from systems.kinematics.joint_filters import JointFilters, JointFiltersState
from systems.kinematics.joint_filters_config import JointFiltersConfig
from systems.kinematics.measurement_errors import MeasurementErrorsConfig
from systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    DisplacementBelief,
    FingertipContact,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
    JointModelBelief,
    JointType,
    displacement_at,
    unknown_displacements,
    unseen,
)
from systems.recursive_filter import RecursiveFilter
from systems.ticks import tick_period


def _filters() -> JointFiltersConfig:
    return JointFiltersConfig(
        radius=0.1, axis_distance=0.1, errors=MeasurementErrorsConfig(declared_time=3.0)
    )


@dataclass(kw_only=True)
class FlapJointConfig:
    """Configuration of `FlapJoint`."""

    period: float = tick_period()
    filters: JointFiltersConfig = field(default_factory=_filters)
    # How far the contact wanders on the flap, across its edge and radially.
    walk: float = number(0.002, at_least=1e-6, at_most=1.0, unit="m")
    # Rotation about the normal: the axis lies in the flap, but for what its first normal errs.
    twist: float = number(0.02, at_least=1e-6, at_most=10.0, unit="rad")
    # Direction of a normal that is not seen.
    unseen_normal: float = number(0.5, at_least=1e-6, at_most=10.0, unit="rad")
    # Error of a normal that stays for seconds: faces are not flat.
    flatness: float = number(1e-3, at_least=0.0, at_most=1.0, unit="rad")
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
        reference: What was seen and touched at first; None before.
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
    reference: Keyframe | None = None
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
        config: See `FlapJointConfig`.
        limits: Of what is believed.
        camera: Whose planes these are, as it is calibrated.

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


def corrected(
    plane: FlapPlane, contact: FingertipContact, displacements: DisplacementBelief
) -> tuple[FlapPlane, FingertipContact]:
    """The plane's normal and the contact's place without what is known of their displacements."""
    finger = displacement_at(contact.p_WC, displacements.p_WQ) @ displacements.of(FINGER)[0]
    contact = replace(contact, p_WC=contact.p_WC - finger)
    if plane.seen:
        n = plane.n_W - np.cross(displacements.of(CAMERA)[0][:3], plane.n_W)
        plane = replace(plane, n_W=n / np.linalg.norm(n))
    return plane, contact


def update_joint(
    state: FlapJointState,
    plane: FlapPlane,
    contact: FingertipContact,
    displacements: DisplacementBelief,
    time: float,
    model: FlapJointModel,
) -> FlapJointState:
    """The state after one tick.

    A flap that nobody touches turns as it is seen, and its pose has no position; unseen, its angle
    is predicted.
    """
    config, touching = model.config, contact.contact.touching
    unmeasured = None if state.filters is None else model.now(state.filters, time)
    if not displacements.known or not (touching or (plane.seen and state.filters is not None)):
        return replace(state, model=unmeasured, measured=False)
    if state.displacements is None:
        state = replace(state, displacements=displacements.about(contact.p_WC))
    assert state.displacements is not None
    plane, contact = corrected(plane, contact, state.displacements)
    state = replace(state, p_WC=contact.p_WC if touching else state.p_WC, measured=plane.seen)
    if state.filters is None or state.model is None:
        return _add_reference(state, plane, contact, time, model) if plane.seen else state
    n = expected_normal(state, state.model, model)
    n_covariance = config.unseen_normal**2 * np.eye(3)
    lasting = config.flatness**2 * np.eye(3)
    if plane.seen:
        n = plane.n_W if plane.n_W @ n > 0.0 else -plane.n_W
        n_covariance = plane.covariance[:3, :3]
        lasting += tilt_covariance(model.camera, state.n0_W, n)
    walk = config.walk**2 * np.eye(3)
    contact = replace(contact, p_WC=state.p_WC)
    pose = flap_pose(state.n0_W, n, n_covariance, lasting, contact, walk, config.twist)
    if not touching:
        pose = without_position(pose)
    after = model.filters.update(state.filters, pose.X_WB, pose.covariance, time, pose.correlated)
    m = model.now(after, time)
    sign = 1.0 if m.configuration[0] >= 0.0 else -1.0
    return replace(state, filters=after, model=m, n_W=n, sign=sign)


def _add_reference(
    state: FlapJointState,
    plane: FlapPlane,
    contact: FingertipContact,
    time: float,
    model: FlapJointModel,
) -> FlapJointState:
    """The state after one more image of the flap at rest; the last one starts the filters."""
    config = model.config
    tick = begin(contact, plane, 1)
    reference = tick if state.reference is None else merge(state.reference, tick)
    state = replace(state, reference=reference, n_W=reference.n_W)
    moved = float(np.linalg.norm(contact.p_WC - reference.p_WC0))
    if reference.ticks < config.reference_images and moved < config.at_rest:
        return state
    n, noise = reference.n_W, reference.plane_covariance[:3, :3] / reference.ticks
    mean = replace(contact, p_WC=reference.p_WC)
    walk, lasting = config.walk**2 * np.eye(3), config.flatness**2 * np.eye(3)
    pose = flap_pose(n, n, noise, lasting, mean, walk, config.twist)
    start = model.filters.start(pose.X_WB, pose.covariance, time)
    return replace(state, filters=start, n0_W=n, n0_noise=noise, model=model.now(start, time))


def angle_at_reference(
    state: FlapJointState, k: Array, p_PA: Array, config: FlapJointConfig
) -> tuple[float, float]:
    """How far the flap was turned in the mean of the reference's images, and its variance.

    The contact has moved since it began, and wandered meanwhile; of the angle that the filters
    count from there, the reference's noise is an error, too.
    """
    reference = state.reference
    assert reference is not None
    u = reference.p_WC - p_PA
    u = u - k * (k @ u)
    along = np.cross(k, u) / (u @ u)
    along_0 = np.cross(k, state.n0_W)
    time = 0.5 * reference.ticks * config.period / config.filters.errors.declared_time
    wandered = 2.0 * config.walk**2 * (1.0 - np.exp(-time))
    moved = reference.p_WC_covariance + wandered * np.eye(3)
    variance = float(along @ moved @ along + along_0 @ state.n0_noise @ along_0)
    return float(along @ (reference.p_WC - reference.p_WC0)), variance


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
        lean = m.axis_covariance + _turned(k, camera)
        covariance = spread * np.outer(along, along) + float(n @ lean @ n) * np.outer(k, k)
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


class FlapJoint(RecursiveFilter):
    """Hinge and angle of the flap by joint filters, from poses of the flap.

    The poses are made of planes and contacts (`flap_pose`); the filters are `JointFilters`, which
    know nothing of flaps, of which the revolute model is read.

    .. pydrake_system::

        name: FlapJoint
        input_ports:
        - flap_plane_estimated
        - fingertip_contact_estimated
        - displacements_estimated
        output_ports:
        - hinge_estimated
        - hinge_latest
        - flap_angle_estimated
        - flap_angle_latest

    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `displacements_estimated`: `DisplacementBelief` of camera, holder and finger.
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.
    - `flap_angle_estimated`: `FlapAngleBelief` of this tick.
    - `flap_angle_latest`: the one of the last tick, from the state.

    Args:
        config: See `FlapJointConfig`.
        camera: Whose planes these are, with its calibration's errors.
        limits: Of what is believed.
    """

    def __init__(
        self,
        config: FlapJointConfig,
        camera: DepthCamera,
        limits: HingeLimitsConfig | None = None,
    ) -> None:
        super().__init__()
        limits = limits or HingeLimitsConfig()
        model = self._model = FlapJointModel(config, limits, camera)
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._displacements = self._declare_value_input(
            "displacements_estimated", unknown_displacements(NAMES)
        )
        self._declare_recursion(FlapJointState(), self._calc_state, config.period)
        self._declare_estimated("hinge_estimated", lambda s: read_joint_hinge(s, limits))
        self._declare_latest("hinge_latest", lambda s: read_joint_hinge(s, limits))
        self._declare_estimated("flap_angle_estimated", lambda s: read_joint_angle(s, model))
        self._declare_latest("flap_angle_latest", lambda s: read_joint_angle(s, model))

    def _calc_state(self, context: Context, state: FlapJointState) -> FlapJointState:
        return update_joint(
            state,
            self._read(self._plane, context),
            self._read(self._contact, context),
            self._read(self._displacements, context),
            context.get_time(),
            self._model,
        )
