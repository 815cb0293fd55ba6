"""The system that finds the axis about which a flap turns, from what is seen and touched of it."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context

from maths import se3
from maths.arrays import Array
from maths.immutable import Immutable
from maths.validation import check, number
from maths.vectors import tangent_basis
from systems.flap.depth_camera import DepthCamera, displacement_covariance
from systems.flap.hinge_geometry import (
    AXIS,
    POINT,
    SIZE,
    TOUCH,
    HingeModel,
    displacement,
    first_model,
    front_normal,
)
from systems.flap.hinge_keyframes import Keyframe, StackedKeyframes, append, begin, stack
from systems.flap.hinge_solver import HingePriors, make_priors, solve
from systems.port_values import (
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    FingertipContact,
    FlapPlane,
    HingeBelief,
    unseen,
)
from systems.recursive_filter import RecursiveFilter
from systems.ticks import tick_period


@dataclass(kw_only=True)
class HingeEstimatorConfig:
    """Configuration of `HingeEstimator`."""

    period: float = tick_period()
    # Path of the contact that one keyframe spans.
    spacing: float = number(0.003, at_least=1e-4, at_most=1.0, unit="m")
    # Keyframes kept.
    memory: int = number(64, at_least=4, at_most=1000)
    # Prior of the axis' distance from the contact.
    tool_size: float = number(0.1, at_least=0.01, at_most=10.0, unit="m")
    # Prior of the faces' and of the contact's distance from the axis, along the normal.
    offset: float = number(0.02, at_least=1e-4, at_most=1.0, unit="m")
    # How far the contact wanders on the flap's edge, along the flap.
    walk_along: float = number(0.001, at_least=1e-6, at_most=1.0, unit="m")
    # The same along the normal, which is the edge's thickness.
    walk_across: float = number(0.004, at_least=1e-6, at_most=1.0, unit="m")
    # Error of a plane's direction that averaging does not lessen.
    plane_direction: float = number(1e-3, at_least=1e-6, at_most=1.0, unit="rad")
    # The same of its distance.
    plane_distance: float = number(3e-4, at_least=1e-6, at_most=1.0, unit="m")
    # Turn below which nothing is believed.
    least_turn: float = number(0.12, above=0.0, at_most=3.0, unit="rad")
    # Largest standard deviation of an axis that is believed.
    largest_direction: float = number(0.15, above=0.0, at_most=1.0, unit="rad")
    # Likewise of where it is.
    largest_distance: float = number(0.025, above=0.0, at_most=1.0, unit="m")
    # Most Gauss-Newton steps per tick.
    rounds: int = number(2, at_least=1, at_most=100)


@dataclass(frozen=True, kw_only=True)
class HingeState(Immutable):
    """What is known at one tick.

    Attributes:
        keyframes: What was measured.
        priors: None before the first contact.
        model: The solution; None before there is one.
        belief: What is told of it.
    """

    keyframes: tuple[Keyframe, ...] = ()
    priors: HingePriors | None = None
    model: HingeModel | None = None
    belief: HingeBelief = UNKNOWN_HINGE


def common_displacement(contact: FingertipContact, p_WQ: Array) -> Array:
    """Covariance (6, 6) of how the arm's constant error displaces what is touched, about Q."""
    R = contact.X_WS[:3, :3]
    J = np.zeros((6, 6))
    J[:3, :3] = R
    J[3:, :3] = -se3.skew(p_WQ - contact.X_WS[:3, 3]) @ R
    J[3:, 3:] = R
    return np.asarray(J @ (contact.covariance - contact.white_covariance) @ J.T)


def face_of(model: HingeModel | None, plane: FlapPlane, p_WC: Array, p_WQ: Array) -> int:
    """Which face is seen: 1 the front, -1 the back, 0 none; the first that is seen is the front."""
    if not plane.seen:
        return 0
    if model is None:
        return 1
    return 1 if plane.n_W @ front_normal(model, p_WC, p_WQ) > 0.0 else -1


def read_hinge(model: HingeModel, covariance: Array, p_WC: Array, p_WQ: Array) -> HingeBelief:
    """What is believed of the axis, near the contact p_WC (3,) that was measured last."""
    k = model.k_W
    offset = displacement(model.touch, p_WC, p_WQ)
    along = float(k @ (p_WC - offset - model.p_W))
    J = np.zeros((9, SIZE))
    J[:3, AXIS] = tangent_basis(k)
    J[3:6, POINT] = np.eye(3) - np.outer(k, k)
    J[3:6, AXIS] = along * tangent_basis(k)
    J[6:, TOUCH] = np.hstack([-se3.skew(p_WC - p_WQ), np.eye(3)])
    joint = J @ covariance @ J.T
    return HingeBelief(
        known=True,
        k_W=k,
        p_WK=model.p_W + k * along,
        covariance=joint[:6, :6],
        touch_offset=offset,
        touch_covariance=joint[:, 6:],
    )


def turn(frames: StackedKeyframes) -> float:
    """Angle between the first and the last normal of the front that were seen, [rad]."""
    n = frames.n_W[frames.face > 0.0]
    if len(n) < 2:
        return 0.0
    return float(np.arctan2(np.linalg.norm(np.cross(n[0], n[-1])), n[0] @ n[-1]))


def update_hinge(
    state: HingeState,
    contact: FingertipContact,
    plane: FlapPlane,
    camera: DepthCamera,
    config: HingeEstimatorConfig,
) -> HingeState:
    """The state after one tick; without a contact it stays, for the tool may have been moved."""
    if not contact.contact.touching:
        return state
    priors = state.priors
    if priors is None:
        Q = contact.p_WC
        priors = make_priors(
            Q,
            config.tool_size,
            config.offset,
            (config.walk_along, config.walk_across),
            displacement_covariance(camera, Q),
            common_displacement(contact, Q),
        )
    face = face_of(state.model, plane, contact.p_WC, priors.p_WQ)
    tick = begin(contact, plane, face)
    keyframes = append(state.keyframes, tick, config.spacing, config.memory)
    state = replace(state, keyframes=keyframes, priors=priors)
    frames = stack(keyframes, (config.plane_direction, config.plane_distance))
    model = state.model
    if model is None:
        if turn(frames) < config.least_turn:
            return state
        model = first_model(frames, config.tool_size)
    rounds = config.rounds if state.model is not None else 10 * config.rounds
    model, covariance = solve(model, frames, priors, rounds)
    belief = read_hinge(model, covariance, contact.p_WC, priors.p_WQ)
    axis, point = np.linalg.eigvalsh(belief.covariance[:3, :3]), belief.covariance[3:, 3:]
    known = axis[-1] < config.largest_direction**2
    known &= np.linalg.eigvalsh(point)[-1] < config.largest_distance**2
    return replace(state, model=model, belief=belief if known else UNKNOWN_HINGE)


class HingeEstimator(RecursiveFilter):
    """Axis of the flap's hinge, from the planes of its faces and the circle of the contact.

    Each tick solves for all that is unknown and constant: the axis, how far the faces lie off it,
    where on the flap the finger touches, and by how much camera and finger arm are displaced by
    their calibrations. See `hinge_geometry`. What was measured is averaged into keyframes; of
    these a window is kept.

    .. pydrake_system::

        name: HingeEstimator
        input_ports:
        - flap_plane_estimated
        - fingertip_contact_estimated
        output_ports:
        - hinge_estimated
        - hinge_latest

    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.

    Source: of the use of planes at different times, the paper on visuo-tactile servoing of
    articulated tools, section III-B (Q. Li et al.); the model is ours.

    Args:
        config: See `HingeEstimatorConfig`.
        camera: Whose planes these are, with its calibration's covariances.
    """

    def __init__(self, config: HingeEstimatorConfig, camera: DepthCamera) -> None:
        super().__init__()
        check(config, "HingeEstimator")
        self._config = config
        self._camera = camera
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._declare_recursion(HingeState(), self._calc_state, config.period)
        self._declare_estimated("hinge_estimated", lambda state: state.belief)
        self._declare_latest("hinge_latest", lambda state: state.belief)

    def _calc_state(self, context: Context, state: HingeState) -> HingeState:
        return update_hinge(
            state,
            self._read(self._contact, context),
            self._read(self._plane, context),
            self._camera,
            self._config,
        )
