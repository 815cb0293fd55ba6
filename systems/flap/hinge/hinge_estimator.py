"""The system that finds the axis about which a flap turns, from what is seen and touched of it."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.flap_geometry import (
    CAMERA,
    FINGER,
    NAMES,
    HingeLimitsConfig,
    holder_given_others,
    is_believed,
)
from crossmodal.systems.flap.hinge.hinge_keyframes import (
    Keyframe,
    StackedKeyframes,
    append,
    begin,
    stack,
)
from crossmodal.systems.flap.hinge.hinge_solver import (
    AXIS,
    DISPLACEMENTS,
    POINT,
    SIZE,
    TOUCH,
    HingeModel,
    first_model,
    front_normal,
    make_priors,
    solve,
)
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    DisplacementBelief,
    FingertipContact,
    FlapPlane,
    HingeBelief,
    displacement_at,
    unknown_displacements,
    unseen,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class HingeEstimatorConfig(Ticked):
    """Configuration of `HingeEstimator`."""

    # Path of the contact that one keyframe spans.
    spacing: float = number(0.003, at_least=1e-4, at_most=1.0, unit="m")
    # Keyframes kept.
    memory: int = number(64, at_least=4, at_most=1000)
    # Prior of the axis' distance from the contact.
    tool_size: float = number(0.1, at_least=0.01, at_most=10.0, unit="m")
    # Prior of the faces' and of the contact's distance from the axis, along the normal.
    offset: float = number(0.02, at_least=1e-4, at_most=1.0, unit="m")
    # How far the contact wanders on the flap's edge, along the flap.
    contact_along: float = number(0.001, at_least=1e-6, at_most=1.0, unit="m")
    # The same along the normal, which is the edge's thickness.
    contact_across: float = number(0.004, at_least=1e-6, at_most=1.0, unit="m")
    # Error of a plane's direction that averaging does not lessen.
    plane_direction: float = number(1e-3, at_least=1e-6, at_most=1.0, unit="rad")
    # The same of its distance.
    plane_distance: float = number(3e-4, at_least=1e-6, at_most=1.0, unit="m")
    # Most Gauss-Newton steps per tick.
    rounds: int = number(2, at_least=1, at_most=100)


@dataclass(frozen=True, kw_only=True)
class HingeState(Immutable):
    """What is known at one tick.

    Attributes:
        keyframes: What was measured.
        p_WQ: The first contact (3,), [m]; None before.
        model: The solution; None before there is one.
        belief: What is reported of it.
    """

    keyframes: tuple[Keyframe, ...] = ()
    p_WQ: Array | None = None
    model: HingeModel | None = None
    belief: HingeBelief = UNKNOWN_HINGE


def read_hinge(
    model: HingeModel, covariance: Array, p_WC: Array, displacements: DisplacementBelief
) -> HingeBelief:
    """What is believed of the axis, near the contact p_WC (3,) that was measured last.

    Args:
        covariance: (23, 23) of it.
        displacements: What was known of them before, about the model's Q.
    """
    k, p_WQ = model.k_W, displacements.p_WQ
    offset = displacement_at(p_WC, p_WQ) @ model.touch
    along = float(k @ (p_WC - offset - model.p_W))
    m, G, rest = holder_given_others(displacements)
    J = np.zeros((18, SIZE))
    J[:3, AXIS] = normal_basis(k).T
    J[3:6, POINT] = np.eye(3) - np.outer(k, k)
    J[3:6, AXIS] = along * normal_basis(k).T
    J[6:12, TOUCH] = np.eye(6)
    J[12:, DISPLACEMENTS] = G
    joint = J @ covariance @ J.T
    joint[12:, 12:] += rest
    holder = m + G @ np.concatenate([model.camera, model.touch])
    return HingeBelief(
        known=True,
        k_W=k,
        p_WK=model.p_W + k * along,
        covariance=joint[:6, :6],
        p_WQ=p_WQ,
        displacements=np.concatenate([model.touch, holder]),
        displacement_covariance=joint[:, 6:],
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
    displacements: DisplacementBelief,
    camera: DepthCamera,
    config: HingeEstimatorConfig,
    limits: HingeLimitsConfig,
) -> HingeState:
    """The state after one tick; without a contact it stays, for the tool may have been moved."""
    if not (contact.contact.touching and displacements.known):
        return state
    p_WQ = contact.p_WC if state.p_WQ is None else state.p_WQ
    displacements = displacements.about(p_WQ)
    face = int(plane.seen)  # The first that is seen is the front.
    if plane.seen and state.model is not None:
        towards = plane.n_W @ front_normal(state.model, contact.p_WC, p_WQ)
        face = 1 if towards > 0.0 else -1
    tick = begin(contact, plane, face)
    keyframes = append(state.keyframes, tick, config.spacing, config.memory)
    state = replace(state, keyframes=keyframes, p_WQ=p_WQ)
    frames = stack(keyframes, (config.plane_direction, config.plane_distance))
    model = state.model
    before = displacements.of(CAMERA, FINGER)
    if model is None:
        if turn(frames) < limits.least_turn:
            return state
        model = first_model(frames, config.tool_size, before[0])
    contact_spread = config.contact_along, config.contact_across
    priors = make_priors(p_WQ, config.tool_size, config.offset, contact_spread, before, camera)
    rounds = config.rounds if state.model is not None else 10 * config.rounds
    found = solve(model, frames, priors, rounds)
    if found.misfit > 1.0 and turn(frames) >= limits.least_turn:
        # The tool may have moved in the hand since the model began.
        first = first_model(frames, config.tool_size, before[0])
        afresh = solve(first, frames, priors, 10 * config.rounds)
        found = min(found, afresh, key=lambda solution: solution.cost)
    belief = read_hinge(found.model, found.covariance, contact.p_WC, displacements)
    known = is_believed(belief.covariance[:3, :3], belief.covariance[3:, 3:], limits)
    return replace(state, model=found.model, belief=belief if known else UNKNOWN_HINGE)


class HingeEstimator(RecursiveFilter):
    """Axis of the flap's hinge, from the planes of its faces and the circle of the contact.

    Each tick solves for all that is unknown and constant: the axis, how far the faces lie off it,
    where on the flap the finger touches, and by how much camera and finger arm are displaced by
    their calibrations, of which the registration is the prior, and the camera's image is stretched
    by its. See `hinge_solver`. What was
    measured is averaged into keyframes; of these a window is kept. While they are not of one hinge,
    as where the tool moves in the hand, it is sought afresh, too, and its covariance is larger.

    Input ports:
    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.
    - `displacements_estimated`: `DisplacementBelief` of camera, holder and finger.

    Output ports:
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.

    Source: of the use of planes at different times, the paper on visuo-tactile servoing of
    articulated tools, section III-B (Q. Li et al.); the model is ours.

    Args:
        camera: Whose planes these are, with its calibration's errors; it is assumed to stand still.
    """

    def __init__(
        self,
        config: HingeEstimatorConfig,
        camera: DepthCamera,
        limits: HingeLimitsConfig | None = None,
    ) -> None:
        super().__init__()
        check(config, "HingeEstimator")
        self._config, self._camera = config, camera
        self._limits = limits or HingeLimitsConfig()
        check(self._limits, "HingeEstimator")
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        self._displacements = self._declare_value_input(
            "displacements_estimated", unknown_displacements(NAMES)
        )
        self._declare_recursion(HingeState(), self._calc_state, config.period)
        self._declare_estimated("hinge_estimated", lambda state: state.belief)
        self._declare_latest("hinge_latest", lambda state: state.belief)

    def _calc_state(self, context: Context, state: HingeState) -> HingeState:
        return update_hinge(
            state,
            self._read(self._contact, context),
            self._read(self._plane, context),
            self._read(self._displacements, context),
            self._camera,
            self._config,
            self._limits,
        )
