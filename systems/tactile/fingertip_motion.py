"""Where the fingertip is, what it senses and how its point that touches moves."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.arm_pose import ArmPose, joints_at, offset_variances
from crossmodal.systems.port_values import (
    NO_CONTACT,
    UNKNOWN_FINGERTIP,
    FingertipContact,
    SampleWindow,
    StreamHealth,
    TactileContact,
    no_samples,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.tactile.contact_features import (
    ContactFeaturesConfig,
    check_features,
    contact_of_taxels,
    lasting_covariance,
)
from crossmodal.systems.tactile.taxel_layout import TaxelLayout, indentation, surface_normals
from crossmodal.systems.tactile.taxel_monitor import TaxelState, next_taxel_state, unread_taxels
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class FingertipMotionConfig(Ticked):
    noise = SensorNoise()
    # Velocity of what is touched in the tick in which a contact begins, 1 sigma per axis.
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


def point_jacobian(X_WS: Array, p_SC: Array) -> Array:
    """(3, 6): displacement of the point C in W per xi in X_WS exp(xi)."""
    R_WS = X_WS[:3, :3]
    return np.hstack([-R_WS @ se3.skew(p_SC), R_WS])


def with_point(belief: FingertipContact, white_S: Array) -> FingertipContact:
    """The belief with the contact in the world.

    Args:
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


def with_velocity(
    belief: FingertipContact, last: FingertipContact, config: FingertipMotionConfig
) -> FingertipContact:
    """The belief with the velocity of the fingertip's point that touches, of a tick's two poses.

    A contact that begins moves nobody knows how.

    Args:
        belief: With the contact in the world.
        last: One tick before.
    """
    if not last.contact.touching:
        v_covariance = config.first_velocity**2 * np.eye(3)
        return replace(belief, v_WC=np.zeros(3), v_WC_covariance=v_covariance)
    p_SC, dt = belief.contact.p_SC, config.period
    moved, covariance = np.zeros(3), np.zeros((3, 3))
    for sign, tick in ((1.0, belief), (-1.0, last)):
        J = point_jacobian(tick.X_WS, p_SC)
        moved += sign * (tick.X_WS[:3, 3] + tick.X_WS[:3, :3] @ p_SC)
        covariance += J @ tick.white_covariance @ J.T
    return replace(belief, v_WC=moved / dt, v_WC_covariance=covariance / dt**2)


@dataclass(frozen=True, kw_only=True)
class FingertipState(Immutable):
    """What is remembered between two ticks.

    Attributes:
        belief: The posterior.
        taxels: Up to their last sample.
        health: Of the taxels.
    """

    belief: FingertipContact
    taxels: TaxelState
    health: StreamHealth


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
    """Where the fingertip and its contact are in the world, and how what it touches moves.

    The pose follows from the joints by the arm's own model. Its error has two parts: the encoders'
    noise through the Jacobian, new at every tick, and the error of the arm's base and of the
    joints' zeros, which stays. The contact is that of the mean of the window's taxel samples, as
    deep as its force presses the skin in. What is touched sticks to the skin: its velocity is that
    of the fingertip's own point there, for where the taxels find the contact may jump while nothing
    moves.

    Input ports:
    - `finger_joint_state_window`: `SampleWindow` of (2 n,) positions [rad], velocities [rad/s].
    - `taxel_window`: `SampleWindow` of (T,) forces, [N].

    Output ports:
    - `fingertip_contact_estimated`: `FingertipContact` of this tick; unknown without samples.
    - `fingertip_contact_latest`: `FingertipContact` of the last tick, from the state alone.
    - `health_latest`: `StreamHealth` of the taxels; its fault names those that are left out.

    Frames: W world, S fingertip, C contact point.

    Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, "Estimating an articulated tool's
    kinematics via visuo-tactile based robotic interactive manipulation", IROS 2018, section III.

    Args:
        arm: Its kinematics with their errors; its frame is S.

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
        self._joints = self._declare_value_input("finger_joint_state_window", no_samples(2 * n))
        count = len(layout.p_ST)
        self._taxels = self._declare_value_input("taxel_window", no_samples(count))
        initial = FingertipState(
            belief=UNKNOWN_FINGERTIP,
            taxels=unread_taxels(layout),
            health=StreamHealth(),
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
            joints.times - time, joints.values, config.noise.angle, config.noise.rate
        )
        X_WS, white, lasting = self._arm.Evaluate(q, variance, offset_variances(joints))
        belief = replace(
            UNKNOWN_FINGERTIP,
            X_WS=X_WS,
            covariance=white + lasting,
            white_covariance=white,
            contact=contact,
        )
        if contact.touching:
            belief = with_velocity(with_point(belief, white_S), state.belief, config)
        return replace(state, belief=belief)

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
