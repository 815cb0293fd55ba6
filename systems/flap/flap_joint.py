"""The flap's hinge and angle by the joint filters that serve the cross-modal network, too."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from maths import se3
from maths.arrays import Array
from maths.immutable import Immutable
from maths.validation import check, number
from systems.flap.depth_camera import DepthCamera, displacement_covariance
from systems.flap.flap_angle import turned_normal
from systems.flap.flap_pose import flap_pose
from systems.flap.hinge_estimator import common_displacement
from systems.flap.hinge_keyframes import Keyframe, begin, merge
from systems.kinematics.joint_filters import JointFilters, JointFiltersState
from systems.kinematics.joint_filters_config import JointFiltersConfig
from systems.kinematics.measurement_errors import MeasurementErrorsConfig
from systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    FingertipContact,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
    JointModelBelief,
    JointType,
    unseen,
)
from systems.recursive_filter import RecursiveFilter
from systems.ticks import tick_period

_AXIS_KNOWN = 0.3  # Standard deviation of an axis by which a normal is turned, [rad].


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
    # Error that all angles of the camera share: latency, focal length, faces that are not flat.
    common_error: float = number(0.008, at_least=0.0, at_most=1.0, unit="rad")
    # Images whose average is the reference, from the first touch on.
    reference_images: int = number(15, at_least=1, at_most=1000)
    # Path of the contact after which no more of them are waited for.
    at_rest: float = number(0.002, at_least=0.0, at_most=1.0, unit="m")
    # Angle below which nothing is believed.
    least_turn: float = number(0.12, above=0.0, at_most=3.0, unit="rad")
    # Largest standard deviation of an axis that is believed.
    largest_direction: float = number(0.15, above=0.0, at_most=1.0, unit="rad")
    # Likewise of where it is.
    largest_distance: float = number(0.025, above=0.0, at_most=1.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class FlapJointState(Immutable):
    """What is known at one tick.

    Attributes:
        reference: What was seen and touched at first; None before.
        filters: None before the reference is complete.
        n_W: Normal (3,) of the front that was seen last.
        n0_W: Normal (3,) of the front at the reference.
        n0_covariance: (3, 3), with the camera's calibration.
        model: Of the revolute joint at this tick; None before.
        sign: 1 or -1: of the joint's axis for a positive angle.
        p_WC: Last contact (3,), [m].
        touch: Covariance (3, 3) of the finger's displacement there.
        camera: Covariance (3, 3) of the camera's rotation, in W.
        measured: Whether the flap was seen at this tick.
    """

    reference: Keyframe | None = None
    filters: JointFiltersState | None = None
    n_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_covariance: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    model: JointModelBelief | None = None
    sign: float = 1.0
    p_WC: Array = field(default_factory=lambda: np.full(3, np.nan))
    touch: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    camera: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    measured: bool = False


def _now(filters: JointFilters, state: JointFiltersState, time: float) -> JointModelBelief:
    return filters.belief(state, time).models[JointType.REVOLUTE]


def is_axis_known(model: JointModelBelief, largest: float) -> bool:
    """Whether the standard deviation of the axis' direction is below `largest` [rad]."""
    return bool(np.trace(model.axis_covariance) < largest**2)  # NaN is not.


def expected_normal(state: FlapJointState, model: JointModelBelief) -> Array:
    """The front's normal (3,) by the joint; the one that was seen last while it has no axis."""
    if not is_axis_known(model, _AXIS_KNOWN):
        return state.n_W
    return turned_normal(model.axis_P, state.n0_W, float(model.configuration[0]))


def update_joint(
    state: FlapJointState,
    plane: FlapPlane,
    contact: FingertipContact,
    time: float,
    filters: JointFilters,
    camera: DepthCamera,
    config: FlapJointConfig,
) -> FlapJointState:
    """The state after one tick."""
    if not contact.contact.touching:
        model = None if state.filters is None else _now(filters, state.filters, time)
        return replace(state, model=model, measured=False)
    walk = config.walk**2 * np.eye(3)
    displaced = common_displacement(contact, contact.p_WC)
    seen_about = displacement_covariance(camera, contact.p_WC)
    state = replace(
        state,
        p_WC=contact.p_WC,
        touch=displaced[3:, 3:],
        camera=seen_about[:3, :3],
        measured=plane.seen,
    )
    if state.filters is None or state.model is None:
        return _add_reference(state, plane, contact, time, filters, config) if plane.seen else state
    n = expected_normal(state, state.model)
    n_covariance = config.unseen_normal**2 * np.eye(3)
    if plane.seen:
        n = plane.n_W if plane.n_W @ n > 0.0 else -plane.n_W
        n_covariance = plane.covariance[:3, :3]
    pose = flap_pose(state.n0_W, n, n_covariance, contact, walk, config.twist)
    after = filters.update(state.filters, pose.X_WB, pose.covariance, time, pose.correlated)
    model = _now(filters, after, time)
    angle = float(model.configuration[0])
    return replace(state, filters=after, model=model, n_W=n, sign=1.0 if angle >= 0.0 else -1.0)


def _add_reference(
    state: FlapJointState,
    plane: FlapPlane,
    contact: FingertipContact,
    time: float,
    filters: JointFilters,
    config: FlapJointConfig,
) -> FlapJointState:
    """The state after one more image of the flap at rest; the last one starts the filters."""
    tick = begin(contact, plane, 1)
    reference = tick if state.reference is None else merge(state.reference, tick)
    state = replace(state, reference=reference, n_W=reference.n_W)
    moved = float(np.linalg.norm(contact.p_WC - reference.p_WC0))
    if reference.ticks < config.reference_images and moved < config.at_rest:
        return state
    n, noise = reference.n_W, reference.plane_covariance[:3, :3] / reference.ticks
    mean = replace(contact, p_WC=reference.p_WC)
    pose = flap_pose(n, n, noise, mean, config.walk**2 * np.eye(3), config.twist)
    start = filters.start(pose.X_WB, pose.covariance, time)
    return replace(
        state,
        filters=start,
        n0_W=n,
        n0_covariance=noise + plane.common_covariance[:3, :3],
        model=_now(filters, start, time),
    )


def _turned(k: Array, covariance: Array) -> Array:
    """Covariance (3, 3) of a direction that is turned by small rotations of this covariance."""
    S = se3.skew(k)
    return np.asarray(S @ covariance @ S.T)


def read_joint_hinge(state: FlapJointState, config: FlapJointConfig) -> HingeBelief:
    """The hinge, with the calibrations' errors: the axis as it is seen, its place as touched."""
    m = state.model
    if m is None or not abs(m.configuration[0]) > config.least_turn:
        return UNKNOWN_HINGE
    if not is_axis_known(m, 2.0 * config.largest_direction):
        return UNKNOWN_HINGE
    k = state.sign * m.axis_P
    across = np.eye(3) - np.outer(k, k)
    direction = m.axis_covariance + _turned(k, state.camera)
    along = float(k @ (state.p_WC - m.p_PA))
    point = across @ (m.p_PA_covariance + state.touch) @ across + along**2 * direction
    if (
        np.linalg.eigvalsh(direction)[-1] > config.largest_direction**2
        or np.linalg.eigvalsh(point)[-1] > config.largest_distance**2
    ):
        return UNKNOWN_HINGE
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = direction, point
    covariance[3:, :3] = along * direction
    covariance[:3, 3:] = covariance[3:, :3].T
    # The axis is displaced with what is touched, which makes both errors opposite: what is taken
    # for the displacement is zero.
    with_touch = np.vstack([np.zeros((3, 3)), -across @ state.touch, state.touch])
    return HingeBelief(
        known=True,
        k_W=k,
        p_WK=m.p_PA + k * along,
        covariance=covariance,
        touch_offset=np.zeros(3),
        touch_covariance=with_touch,
    )


def read_joint_angle(
    state: FlapJointState, config: FlapJointConfig, model: JointModelBelief | None = None
) -> FlapAngleBelief:
    """The angle, with a normal that is n0's turned about the axis."""
    m = model or state.model
    if m is None:
        return UNKNOWN_ANGLE
    angle, rate = state.sign * m.configuration
    variance = float(m.configuration_covariance[0, 0]) + config.common_error**2
    n = expected_normal(state, m)
    covariance = state.n0_covariance + variance * (np.eye(3) - np.outer(n, n))
    if is_axis_known(m, _AXIS_KNOWN):
        k = state.sign * m.axis_P
        along, along_0 = np.cross(k, n), np.cross(k, state.n0_W)
        spread = variance + float(along_0 @ state.n0_covariance @ along_0)
        lean = m.axis_covariance + _turned(k, state.camera)
        covariance = spread * np.outer(along, along) + float(n @ lean @ n) * np.outer(k, k)
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
        output_ports:
        - hinge_estimated
        - hinge_latest
        - flap_angle_estimated
        - flap_angle_latest
        - flap_angle_predicted

    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.
    - `flap_angle_estimated`: `FlapAngleBelief` of this tick.
    - `flap_angle_latest`: the one of the last tick, from the state.
    - `flap_angle_predicted`: the one of the next tick, from the state.

    Args:
        config: See `FlapJointConfig`.
        camera: Whose planes these are, with its calibration's covariances.
    """

    def __init__(self, config: FlapJointConfig, camera: DepthCamera) -> None:
        super().__init__()
        check(config, "FlapJoint")
        self._config, self._camera = config, camera
        self._filters = JointFilters(config.filters, owner="FlapJoint")
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._declare_recursion(FlapJointState(), self._calc_state, config.period)
        self._declare_estimated("hinge_estimated", lambda s: read_joint_hinge(s, config))
        self._declare_latest("hinge_latest", lambda s: read_joint_hinge(s, config))
        self._declare_estimated("flap_angle_estimated", lambda s: read_joint_angle(s, config))
        self._declare_latest("flap_angle_latest", lambda s: read_joint_angle(s, config))
        self._declare_latest("flap_angle_predicted", self._predict)

    def _calc_state(self, context: Context, state: FlapJointState) -> FlapJointState:
        return update_joint(
            state,
            self._read(self._plane, context),
            self._read(self._contact, context),
            context.get_time(),
            self._filters,
            self._camera,
            self._config,
        )

    def _predict(self, state: FlapJointState) -> FlapAngleBelief:
        if state.filters is None:
            return UNKNOWN_ANGLE
        ahead = _now(self._filters, state.filters, state.filters.time + self._config.period)
        return read_joint_angle(state, self._config, ahead)
