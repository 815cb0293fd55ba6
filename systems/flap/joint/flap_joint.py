"""The flap's hinge and angle by the joint filters that serve the cross-modal network, too."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.systems.depth_camera import DepthCamera, tilt_covariance
from crossmodal.systems.flap.flap_geometry import FINGER, NAMES, HingeLimitsConfig
from crossmodal.systems.flap.hinge.hinge_keyframes import begin, merge
from crossmodal.systems.flap.joint.flap_joint_model import (
    FlapJointConfig,
    FlapJointModel,
    FlapJointState,
    expected_normal,
    flap_pose,
    mean_noise,
    read_joint_angle,
    read_joint_hinge,
    without_camera,
    without_position,
)
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    DisplacementBelief,
    FingertipContact,
    FlapPlane,
    displacement_at,
    unknown_displacements,
    unseen,
)
from crossmodal.systems.recursive_filter import RecursiveFilter


def corrected(
    plane: FlapPlane, contact: FingertipContact, displacements: DisplacementBelief
) -> tuple[FlapPlane, FingertipContact]:
    """The plane's normal and the contact's place without what is known of their displacements."""
    finger = displacement_at(contact.p_WC, displacements.p_WQ) @ displacements.of(FINGER)[0]
    contact = replace(contact, p_WC=contact.p_WC - finger)
    if plane.seen:
        plane = replace(plane, n_W=without_camera(plane.n_W, displacements))
    return plane, contact


def see_at_rest(state: FlapJointState, plane: FlapPlane, config: FlapJointConfig) -> FlapJointState:
    """The state with one more image of a flap that nobody has touched, since it last moved."""
    tick = begin(UNKNOWN_FINGERTIP, plane, 1)
    rest = state.rest
    if rest is not None:
        noise = plane.covariance[:3, :3] + mean_noise(rest)
        apart = float(np.linalg.norm(np.cross(rest.n_W, plane.n_W)))
        if apart**2 < config.gate**2 * float(np.linalg.eigvalsh(noise)[-1]):
            return replace(state, rest=merge(rest, tick))
    return replace(state, rest=tick)


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
    if state.displacements is None and plane.seen and not touching:
        state = see_at_rest(state, plane, config)
    if not displacements.known or not (touching or (plane.seen and state.filters is not None)):
        return replace(state, model=unmeasured, measured=False)
    if state.displacements is None:
        state = replace(state, displacements=displacements.about(contact.p_WC))
    assert state.displacements is not None
    plane, contact = corrected(plane, contact, state.displacements)
    state = replace(state, p_WC=contact.p_WC if touching else state.p_WC, measured=plane.seen)
    if state.filters is None or state.model is None:
        state = replace(state, moved=state.moved + contact.v_WC * config.period)
        return _add_reference(state, plane, contact, time, model) if plane.seen else state
    n = expected_normal(state, state.model, model)
    n_covariance = config.unseen_normal**2 * np.eye(3)
    correlated_n = config.flatness**2 * np.eye(3)
    if plane.seen:
        n = plane.n_W if plane.n_W @ n > 0.0 else -plane.n_W
        n_covariance = plane.covariance[:3, :3]
        correlated_n += tilt_covariance(model.camera, state.n0_W, n)
    contact = replace(contact, p_WC=state.p_WC)
    spread, twist = config.contact_spread, config.twist
    pose = flap_pose(state.n0_W, n, n_covariance, correlated_n, contact, spread, twist)
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
    mean = state.reference_moved + (state.moved - state.reference_moved) / reference.ticks
    state = replace(state, reference=reference, n_W=reference.n_W, reference_moved=mean)
    moved = float(np.linalg.norm(state.moved))
    if reference.ticks < config.reference_images and moved < config.at_rest:
        return state
    n, noise = reference.n_W, mean_noise(reference)
    contact = replace(contact, p_WC=reference.p_WC)
    correlated_n = config.flatness**2 * np.eye(3)
    pose = flap_pose(n, n, noise, correlated_n, contact, config.contact_spread, config.twist)
    start = model.filters.start(pose.X_WB, pose.covariance, time)
    return replace(state, filters=start, n0_W=n, n0_noise=noise, model=model.now(start, time))


class FlapJoint(RecursiveFilter):
    """Hinge and angle of the flap by joint filters, from poses of the flap.

    The poses are made of planes and contacts (`flap_pose`); the filters are `JointFilters`, which
    know nothing of flaps, of which the revolute model is read.

    Input ports:
    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `displacements_estimated`: `DisplacementBelief` of camera, holder and finger.

    Output ports:
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.
    - `flap_angle_estimated`: `FlapAngleBelief` of this tick.
    - `flap_angle_latest`: the one of the last tick, from the state.

    Args:
        camera: Whose planes these are, with its calibration's errors; it is assumed to stand still.
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
