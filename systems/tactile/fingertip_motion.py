"""Where the fingertip is, what it feels and how the point that it touches moves."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from maths import se3
from maths.arrays import Array
from maths.immutable import Immutable
from maths.validation import check, number
from systems.arm_pose import ArmPose, joints_at, offset_variances
from systems.port_values import (
    NO_CONTACT,
    UNKNOWN_FINGERTIP,
    FingertipContact,
    SampleWindow,
    StreamHealth,
    TactileContact,
)
from systems.recursive_filter import RecursiveFilter
from systems.tactile.contact_features import (
    ContactFeaturesConfig,
    check_features,
    contact_of_taxels,
    lasting_covariance,
)
from systems.tactile.skin import indentation
from systems.tactile.taxel_layout import TaxelLayout, surface_normals
from systems.tactile.taxel_monitor import TaxelState, next_taxel_state, unheard_taxels
from systems.ticks import tick_period


@dataclass(kw_only=True)
class FingertipMotionConfig:
    period: float = tick_period()
    # Standard deviation of one encoder sample, and of a velocity sample.
    position_noise: float = number(1e-4, at_least=1e-9, at_most=1.0, unit="rad")
    velocity_noise: float = number(5e-3, at_least=1e-9, at_most=100.0, unit="rad/s")
    # White acceleration that drives the velocity of the contact point.
    process_noise: float = number(0.003, at_least=1e-9, at_most=100.0, unit="m/s^1.5")
    # Velocity of a contact that has just begun, 1 sigma per axis.
    first_velocity: float = number(0.02, at_least=1e-6, at_most=10.0, unit="m/s")
    # By so much a sample of the taxels may be stamped ahead of the tick.
    newest: float = number(0.005, at_least=0.0, at_most=3600.0, unit="s")
    # Age of their last sample that is a fault.
    stale_after: float = number(0.15, at_least=1e-3, at_most=3600.0, unit="s")
    # Young's modulus of the skin, as of soft silicone.
    skin_modulus: float = number(3e5, at_least=1e3, at_most=1e12, unit="Pa")
    # Standard deviation of how deep it is pressed in, as a share of that.
    indentation_error: float = number(0.5, at_least=0.0, at_most=10.0)
    features: ContactFeaturesConfig = field(default_factory=ContactFeaturesConfig)


@dataclass(frozen=True, kw_only=True)
class PointTrack(Immutable):
    """The contact point's position and velocity.

    Attributes:
        time: [s]
        mean: p_WC and v_WC (6,), [m, m/s].
        covariance: (6, 6) without the errors of p_WC that last.
    """

    time: float
    mean: Array
    covariance: Array


def start_track(time: float, p_WC: Array, R: Array, config: FingertipMotionConfig) -> PointTrack:
    """The track of a contact that begins at `p_WC` (3,), known to R (3, 3)."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = R
    covariance[3:, 3:] = config.first_velocity**2 * np.eye(3)
    return PointTrack(time=time, mean=np.concatenate([p_WC, np.zeros(3)]), covariance=covariance)


def follow(track: PointTrack, time: float, p_WC: Array, R: Array, density: float) -> PointTrack:
    """The track after one more measurement `p_WC` (3,) with covariance R (3, 3).

    A Kalman filter with constant velocity, driven by white acceleration of root density `density`,
    [m/s^1.5].
    """
    dt = time - track.time
    F = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(3))
    unit = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    P = F @ track.covariance @ F.T + density**2 * np.kron(unit, np.eye(3))
    mean = F @ track.mean
    K = np.linalg.solve(P[:3, :3] + R, P[:3]).T
    remainder = np.eye(6) - K @ np.eye(3, 6)
    posterior = remainder @ P @ remainder.T + K @ R @ K.T
    return PointTrack(
        time=time,
        mean=mean + K @ (p_WC - mean[:3]),
        covariance=0.5 * (posterior + posterior.T),
    )


def point_jacobian(X_WS: Array, p_SC: Array) -> Array:
    """(3, 6): displacement of the point C in W per xi in X_WS exp(xi)."""
    R_WS = X_WS[:3, :3]
    return np.hstack([-R_WS @ se3.skew(p_SC), R_WS])


def with_point(belief: FingertipContact, white_S: Array) -> FingertipContact:
    """The belief with the contact in the world.

    Args:
        belief: With pose and contact.
        white_S: The part (3, 3) of the contact's covariance that is new at every tick.
    """
    X_WS, contact = belief.X_WS, belief.contact
    J, R_WS = point_jacobian(X_WS, contact.p_SC), X_WS[:3, :3]
    return replace(
        belief,
        p_WC=X_WS[:3, 3] + R_WS @ contact.p_SC,
        p_WC_covariance=J @ belief.covariance @ J.T + R_WS @ contact.covariance @ R_WS.T,
        p_WC_white_covariance=J @ belief.white_covariance @ J.T + R_WS @ white_S @ R_WS.T,
    )


@dataclass(frozen=True, kw_only=True)
class FingertipState(Immutable):
    """What is remembered between two ticks.

    Attributes:
        belief: The posterior.
        taxels: Up to their last sample.
        health: Of the taxels.
        track: Of the contact point; None without a contact.
    """

    belief: FingertipContact
    taxels: TaxelState
    health: StreamHealth
    track: PointTrack | None


def new_samples(window: SampleWindow, last: float, now: float, newest: float) -> SampleWindow:
    """The samples that are later than the `last` one and not stamped ahead of `now`, [s]."""
    new = (window.times > last) & (window.times <= now + newest)
    return replace(window, times=window.times[new], values=window.values[new])


def health_of(taxels: TaxelState, now: float, stale_after: float) -> StreamHealth:
    """Of the taxels' stream: silence first, then what is wrong with single ones."""
    silence = now - max(taxels.time, 0.0)
    if silence > stale_after:
        return StreamHealth(age=silence, fault="no samples")
    health = taxels.health
    return replace(health, age=max(silence, health.age))


class FingertipMotion(RecursiveFilter):
    """Where the fingertip and its contact are in the world, and how the contact point moves.

    The pose follows from the joints by the arm's own model. Its error has two parts: the encoders'
    noise through the Jacobian, new at every tick, and the error of the arm's base and of the
    joints' zeros, which stays. The contact is what the mean of the window's taxel samples says, as
    deep as its force presses the skin in. The contact point's velocity comes from a Kalman filter
    on its positions; the positions themselves are given as each tick measures them.

    .. pydrake_system::

        name: FingertipMotion
        input_ports:
        - finger_joint_state_window
        - taxel_window
        output_ports:
        - fingertip_contact_estimated
        - fingertip_contact_latest
        - health_latest

    - `finger_joint_state_window`: `SampleWindow` of (2 n,) positions [rad], velocities [rad/s].
    - `taxel_window`: `SampleWindow` of (T,) forces, [N].
    - `fingertip_contact_estimated`: `FingertipContact` of this tick; unknown without samples.
    - `fingertip_contact_latest`: `FingertipContact` of the last tick, from the state alone.
    - `health_latest`: `StreamHealth` of the taxels; its fault names those that are left out.

    Frames: W world, S fingertip, C contact point.

    Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, "Estimating an articulated tool's
    kinematics via visuo-tactile based robotic interactive manipulation", IROS 2018, section III.

    Args:
        config: Noise.
        arm: Its kinematics with their errors; its frame is S.
        layout: Of the taxels.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self,
        config: FingertipMotionConfig,
        arm: ArmPose,
        layout: TaxelLayout,
    ) -> None:
        super().__init__()
        check(config, "FingertipMotion")
        check_features(config.features, "FingertipMotion")
        n = arm.num_joints
        self._config, self._layout, self._arm = config, layout, arm
        self._joints = self._declare_value_input("finger_joint_state_window", _no_samples(2 * n))
        count = len(layout.p_ST)
        self._taxels = self._declare_value_input("taxel_window", _no_samples(count))
        initial = FingertipState(
            belief=UNKNOWN_FINGERTIP,
            taxels=unheard_taxels(layout),
            health=StreamHealth(),
            track=None,
        )
        self._declare_recursion(initial, self._calc_motion, config.period)
        self._declare_estimated("fingertip_contact_estimated", lambda state: state.belief)
        self._declare_latest("fingertip_contact_latest", lambda state: state.belief)
        self._declare_latest("health_latest", lambda state: state.health)

    def _calc_motion(self, context: Context, state: FingertipState) -> FingertipState:
        joints: SampleWindow = self._read(self._joints, context)
        config, time = self._config, context.get_time()
        window = new_samples(
            self._read(self._taxels, context), state.taxels.time, time, config.newest
        )
        taxels, contact, white_S = self._feel(state.taxels, window)
        state = replace(state, taxels=taxels, health=health_of(taxels, time, config.stale_after))
        if joints.times.size == 0:
            return replace(state, belief=UNKNOWN_FINGERTIP)
        q, variance = joints_at(
            joints.times - time, joints.values, config.position_noise, config.velocity_noise
        )
        X_WS, white, lasting = self._arm.Evaluate(q, variance, offset_variances(joints))
        belief = replace(
            UNKNOWN_FINGERTIP,
            X_WS=X_WS,
            covariance=white + lasting,
            white_covariance=white,
            contact=contact,
        )
        if not contact.touching:
            return replace(state, belief=belief, track=None)
        belief = with_point(belief, white_S)
        R = belief.p_WC_white_covariance
        track = (
            start_track(time, belief.p_WC, R, self._config)
            if state.track is None
            else follow(state.track, time, belief.p_WC, R, self._config.process_noise)
        )
        belief = replace(belief, v_WC=track.mean[3:], v_WC_covariance=track.covariance[3:, 3:])
        return replace(state, belief=belief, track=track)

    def _feel(
        self, taxels: TaxelState, window: SampleWindow
    ) -> tuple[TaxelState, TactileContact, Array]:
        """The taxels, the contact that their mean shows, and its white covariance (3, 3)."""
        features, layout = self._config.features, self._layout
        for time, forces in zip(window.times, window.values, strict=True):
            taxels = next_taxel_state(taxels, float(time), forces, layout, features)
        contact, count = NO_CONTACT, len(window.times)
        if taxels.contact.touching and count:
            mean = window.values.mean(axis=0)
            contact = contact_of_taxels(mean, True, taxels.usable, layout, features, count)
        if not contact.touching:
            return taxels, NO_CONTACT, NO_CONTACT.covariance
        white = contact.covariance - lasting_covariance(
            contact.p_SC, taxels.usable, layout, features
        )
        return taxels, self._pressed_in(contact), white

    def _pressed_in(self, contact: TactileContact) -> TactileContact:
        """The contact where the skin is, which gives way to what it touches."""
        config, semi_axes = self._config, self._layout.semi_axes
        n_S = surface_normals(contact.p_SC, semi_axes)
        depth = indentation(contact.force, config.skin_modulus, semi_axes)
        error = config.indentation_error * depth
        return replace(
            contact,
            p_SC=contact.p_SC - depth * n_S,
            covariance=contact.covariance + error**2 * np.outer(n_S, n_S),
        )


def _no_samples(size: int) -> SampleWindow:
    return SampleWindow(times=np.zeros(0), values=np.zeros((0, size)))
