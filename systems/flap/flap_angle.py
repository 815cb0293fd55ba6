"""How far the flap is turned: predicted by the finger's motion, corrected by the camera."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import joseph_update
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.depth_camera import DepthCamera, angle_variance
from crossmodal.systems.flap.flap_geometry import angle_about, lever, turned_normal
from crossmodal.systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    FingertipContact,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
    unseen,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class FlapAngleConfig(Ticked):
    """Configuration of `FlapAngleFilter`."""

    # Lever of the contact before the hinge is known.
    lever: float = number(0.085, at_least=1e-3, at_most=10.0, unit="m")
    # Its standard deviation as a share of it.
    lever_error: float = number(0.3, at_least=0.0, at_most=10.0)
    # Least such share with a known hinge: the contact wanders.
    least_lever_error: float = number(0.01, at_least=0.0, at_most=10.0)
    # Within which a hinge that is seen gets another lever, of another error.
    lever_time: float = number(1.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Standard deviation of the flap's angle against the finger's motion, after one second.
    slip: float = number(0.004, at_least=1e-6, at_most=10.0, unit="rad")
    # Rate of a flap that nobody touches: it holds itself by friction.
    free_rate: float = number(0.1, at_least=0.0, at_most=100.0, unit="rad/s")
    # Below this angle the flap is where it was touched first, if it was not seen before.
    at_rest: float = number(0.01, at_least=0.0, at_most=1.0, unit="rad")
    # Innovation in standard deviations from which a measurement counts for less.
    gate: float = number(3.0, above=0.0, at_most=100.0)


@dataclass(frozen=True, kw_only=True)
class FlapAngleState(Immutable):
    """The filter's state.

    Attributes:
        x: Angle [rad], relative error of the rate, and how much farther the normal is turned from
            n0_W than the angle says [rad] (3,).
        P: Their covariance (3, 3).
        touched: Whether the flap was touched.
        rate: [rad/s]
        measured: Whether the camera corrected the angle at this tick.
        k_W: Axis (3,); None while the hinge is not known.
        k_covariance: (3, 3).
        n0_W: Normal (3,) of the face that was seen first; None before.
        n0_common: Its covariance (3, 3) by the camera's calibration.
        n_W: Normal (3,) of that face at this tick; None before.
        n_covariance: (3, 3).
        rest_images: How many images are averaged into n0_W.
    """

    x: Array
    P: Array
    touched: bool = False
    rate: float = 0.0
    measured: bool = False
    k_W: Array | None = None
    k_covariance: Array | None = None
    n0_W: Array | None = None
    n0_common: Array = field(default_factory=lambda: np.zeros((3, 3)))
    n_W: Array | None = None
    n_covariance: Array | None = None
    rest_images: int = 0


UNTOUCHED = FlapAngleState(x=np.zeros(3), P=np.zeros((3, 3)))


def contact_rate(
    hinge: HingeBelief, contact: FingertipContact, n_W: Array | None, config: FlapAngleConfig
) -> tuple[float, float, float]:
    """Rate [rad/s] by the contact's motion v = theta_dot k x u, its variance, and sigma_u / u."""
    v, V = contact.v_WC, contact.v_WC_covariance
    if hinge.known:
        arm = lever(hinge, contact)
        r = arm.length
        along = np.cross(hinge.k_W, arm.u_W) / r
        share = max(float(np.sqrt(arm.length_variance)) / r, config.least_lever_error)
        return float(along @ v) / r, float(along @ V @ along) / r**2, share
    # The free edge begins to move out of the front.
    r = config.lever
    rate = float(np.linalg.norm(v)) if n_W is None else float(n_W @ v)
    return rate / r, float(np.linalg.eigvalsh(V)[-1]) / r**2, config.lever_error


def predict(
    state: FlapAngleState, rate: float, variance: float, dt: float, config: FlapAngleConfig
) -> FlapAngleState:
    """theta += rate (1 + s) dt."""
    F = np.eye(3)
    F[0, 1] = rate * dt
    Q = np.diag([variance * dt**2 + config.slip**2 * dt, 0.0, 0.0])
    x = state.x + np.array([rate * (1.0 + state.x[1]) * dt, 0.0, 0.0])
    return replace(state, x=x, P=F @ state.P @ F.T + Q, rate=rate, measured=False)


def renew_lever(state: FlapAngleState, share: float, passed: float) -> FlapAngleState:
    """The state with a lever that the hinge has changed meanwhile.

    The hinge learns from the same planes as the angle. What the angle has learnt of an earlier
    lever's error is forgotten, and that of the lever is as large as the hinge says.

    Args:
        share: Standard deviation of the lever's relative error.
        passed: Time, as a share of that within which the lever changes; infinite for another one.
    """
    kept = np.array([1.0, np.exp(-passed), 1.0])
    P = state.P * np.outer(kept, kept)
    P[1, 1] += (1.0 - kept[1] ** 2) * share**2
    return replace(state, x=state.x * kept, P=P)


def correct(
    state: FlapAngleState, k: Array, plane: FlapPlane, touching: bool, config: FlapAngleConfig
) -> FlapAngleState:
    """Correction by the angle of the plane's normal about k; either face may be seen.

    What is far off counts for less, but of a flap that nobody touches: somebody has moved it.
    """
    assert state.n0_W is not None
    H = np.array([[1.0, 0.0, 1.0]])
    apart = angle_about(k, state.n0_W, plane.n_W) - float(state.x[0] + state.x[2])
    apart -= np.pi * np.round(apart / np.pi)  # The back is the front turned by half a turn.
    along = np.cross(k, plane.n_W)
    R = float(along @ plane.covariance[:3, :3] @ along)
    P = state.P.copy()
    S = float((H @ P @ H.T)[0, 0]) + R
    beyond = max(0.0, apart**2 / config.gate**2 - S)
    if touching:
        R += beyond
    elif beyond > 0.0:
        P[0, 0] += apart**2
    dx, P = joseph_update(P, H, np.array([[R]]), np.array([apart]))
    return replace(state, x=state.x + dx, P=P, measured=True)


def see_untouched(
    state: FlapAngleState, plane: FlapPlane, config: FlapAngleConfig
) -> FlapAngleState:
    """The state with the mean normal of a flap that nobody has touched, since it last moved."""
    if not plane.seen:
        return state
    if state.n0_W is not None:
        noise = float(np.linalg.eigvalsh(plane.covariance[:3, :3])[-1])
        apart = float(np.linalg.norm(np.cross(state.n0_W, plane.n_W)))
        if apart**2 > config.gate**2 * (noise + state.P[2, 2]):
            state = UNTOUCHED
    return see_first(state, plane, config)


def see_first(state: FlapAngleState, plane: FlapPlane, config: FlapAngleConfig) -> FlapAngleState:
    """The state with the normal that angles are measured from, averaged while the flap rests."""
    at_rest = abs(state.x[0]) < config.at_rest
    count = state.rest_images
    if state.n0_W is not None and not (at_rest and count):
        return state
    variance = float(np.linalg.eigvalsh(plane.covariance[:3, :3])[-1])
    x, P = state.x.copy(), state.P.copy()
    if state.n0_W is None:
        # The first normal is the reference: no rotation yet.
        J = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
        x[2], P = -x[0], J @ P[:2, :2] @ J.T
        P[2, 2] += variance
        images, common = int(at_rest), plane.common_covariance[:3, :3]
        return replace(state, x=x, P=P, n0_W=plane.n_W, n0_common=common, rest_images=images)
    n0 = count * state.n0_W + plane.n_W
    x[2] = (count * x[2] - x[0]) / (count + 1)
    P[2], P[:, 2] = P[2] * count / (count + 1), P[:, 2] * count / (count + 1)
    P[2, 2] += variance / (count + 1) ** 2
    n0 = n0 / np.linalg.norm(n0)
    return replace(state, x=x, P=P, n0_W=n0, rest_images=count + 1)


def _across(n: Array) -> Array:
    """Projects (3, 3) onto the plane across a unit normal (3,)."""
    return np.eye(3) - np.outer(n, n)


def with_normal(state: FlapAngleState, plane: FlapPlane) -> FlapAngleState:
    """The state with the normal that goes with its angle."""
    if state.n0_W is None:
        return state
    k = state.k_W
    if k is None or state.k_covariance is None:
        if plane.seen:
            covariance = (plane.covariance + plane.common_covariance)[:3, :3]
            return replace(state, n_W=plane.n_W, n_covariance=covariance)
        n, spread = state.n_W, state.n_covariance
        if n is None or spread is None:  # It was last seen before it was touched.
            n, spread = state.n0_W, state.n0_common + state.P[2, 2] * _across(state.n0_W)
        return replace(state, n_W=n, n_covariance=spread + state.P[0, 0] * _across(n))
    n = turned_normal(k, state.n0_W, float(state.x[0] + state.x[2]))
    along = np.cross(k, n)
    variance = float(state.P[0, 0] + 2.0 * state.P[0, 2] + state.P[2, 2])
    along_0 = np.cross(k, state.n0_W)
    variance += float(along_0 @ state.n0_common @ along_0)
    # A normal that is measured about k is tilted with k: dn = -k (n · dk).
    tilt = float(n @ state.k_covariance @ n)
    covariance = variance * np.outer(along, along) + tilt * np.outer(k, k)
    return replace(state, n_W=n, n_covariance=covariance)


def update_angle(
    state: FlapAngleState,
    plane: FlapPlane,
    contact: FingertipContact,
    hinge: HingeBelief,
    config: FlapAngleConfig,
) -> FlapAngleState:
    """The state after one tick."""
    dt = config.period
    touching, was_known = contact.contact.touching, state.k_W is not None
    if not state.touched:
        if not touching:
            return see_untouched(state, plane, config)
        # What yields to less than is sensed has turned already.
        P = np.diag([config.slip**2 * dt, config.lever_error**2, state.P[2, 2]])
        state = replace(state, touched=True, P=P, rest_images=0)
    elif touching:
        rate, variance, share = contact_rate(hinge, contact, state.n_W, config)
        if hinge.known and (plane.seen or not was_known):
            # From now on the rate is measured with this hinge's lever.
            state = renew_lever(state, share, dt / config.lever_time if was_known else np.inf)
        state = predict(state, rate, variance, dt, config)
    else:
        state = predict(state, 0.0, config.free_rate**2, dt, config)
    if hinge.known:
        state = replace(state, k_W=hinge.k_W, k_covariance=hinge.covariance[:3, :3])
    if plane.seen:
        state = see_first(state, plane, config)
        if state.k_W is not None:
            # Before the axis was known the angle was that of an assumed lever.
            state = correct(state, state.k_W, plane, touching and was_known, config)
    return with_normal(state, plane)


def read_angle(state: FlapAngleState, camera: DepthCamera) -> FlapAngleBelief:
    """What is believed of the angle."""
    if not state.touched or state.n_W is None or state.n_covariance is None:
        return UNKNOWN_ANGLE
    n, n0, k = state.n_W, state.n0_W, state.k_W
    along = np.eye(3) - np.outer(n, n)
    common = 0.0
    if n0 is not None:
        axis = np.cross(n0, n) if k is None else k
        common = angle_variance(camera, axis, n0, n, state.rate)
    if k is not None:
        along = along - np.outer(k, k)
    return FlapAngleBelief(
        known=True,
        theta=float(state.x[0]),
        variance=float(state.P[0, 0]) + common,
        rate=state.rate,
        n_W=n,
        n_covariance=state.n_covariance + common * along,
        measured=state.measured,
    )


class FlapAngleFilter(RecursiveFilter):
    """Angle of the flap by a Kalman filter.

    The contact at u from the axis moves at v = theta_dot k x u, which predicts the angle; where
    the camera sees the flap, the angle of its normal about k corrects it:

        theta += (1 + s) theta_dot dt,    theta_m = theta + beta,

    with the lever's relative error s and the error beta of the normal at theta = 0, both unknown
    constants. In a blackout the prediction alone turns the normal (Rodrigues). Before the hinge
    is known, the angle is that of the finger's path over an assumed lever.

    Input ports:
    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `hinge_estimated`: `HingeBelief` of this tick, in W.

    Output ports:
    - `flap_angle_estimated`: `FlapAngleBelief` of this tick.
    - `flap_angle_latest`: the one of the last tick, from the state.

    Source: the paper on visuo-tactile servoing of articulated tools, equations 4 to 6 (Q. Li et
    al.); the gain, which is tuned there, follows from the covariances here.

    Args:
        camera: Whose planes these are, with its calibration's errors; it is assumed to stand still.
    """

    def __init__(self, config: FlapAngleConfig, camera: DepthCamera) -> None:
        super().__init__()
        check(config, "FlapAngleFilter")
        self._config = config
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._hinge = self._declare_value_input("hinge_estimated", UNKNOWN_HINGE)
        self._declare_recursion(UNTOUCHED, self._calc_state, config.period)
        self._declare_estimated("flap_angle_estimated", lambda s: read_angle(s, camera))
        self._declare_latest("flap_angle_latest", lambda s: read_angle(s, camera))

    def _calc_state(self, context: Context, state: FlapAngleState) -> FlapAngleState:
        return update_angle(
            state,
            self._read(self._plane, context),
            self._read(self._contact, context),
            self._read(self._hinge, context),
            self._config,
        )
