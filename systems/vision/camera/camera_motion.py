"""The system that notices when the camera itself has been knocked out of its place."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.gaussian import outlier_gate
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.port_values import (
    HEALTHY,
    IN_PLACE,
    STATIC_BODY,
    CameraDisplacement,
    ExpectedFeatures,
    FeatureBelief,
    StreamHealth,
    no_expectations,
    no_features,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked, whole_ticks
from crossmodal.systems.vision.bodies.feature_displacements import squared_distances
from crossmodal.systems.vision.bodies.rigid_body_motion_config import BodyDynamicsConfig
from crossmodal.systems.vision.camera.camera_jump import (
    CameraJumpConfig,
    Displacement,
    fit_displacement,
    jump_odds,
)
from crossmodal.systems.vision.camera_geometry import transform

_GATE = outlier_gate(3)
# Median squared distance, 2.4 of noise alone, up to which most features are where they were
# expected, so that no motion of theirs needs to be fitted.
_USUAL = 3.0
_GROUP = 3  # Features of a body that have to follow a motion.


@dataclass(kw_only=True)
class CameraMotionConfig(Ticked):
    """When a camera is taken to have moved, and how exactly it is found where to."""

    jump: CameraJumpConfig = field(default_factory=CameraJumpConfig)
    # Error of a feature's position that averaging does not remove.
    floor: float = number(2e-4, at_least=1e-6, at_most=1.0, unit="m")
    # For so long after a jump, what is at rest is compared with where it was.
    settling: float = number(2.0, at_least=0.0, at_most=60.0, unit="s")


@dataclass(frozen=True, kw_only=True)
class Landmarks(Immutable):
    """What was seen before a jump, and how it is seen since, by the camera's place S.

    Attributes:
        ids: Of features (N,).
        moves: Which (N,) are of a body that moved when the camera jumped, and are compared at that
            tick only.
        p_W: Where they were, or were expected by then (N, 3), [m].
        C: Covariances of these (N, 3, 3), [m^2].
        information: Sum over the ticks since (N, 3, 3), of p_WF as if the camera still stood in S.
        moment: Sum of information times position (N, 3).
    """

    ids: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    moves: Mask = field(default_factory=lambda: np.zeros(0, bool))
    p_W: Array = field(default_factory=lambda: np.zeros((0, 3)))
    C: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    information: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    moment: Array = field(default_factory=lambda: np.zeros((0, 3)))


def _still() -> Array:
    return np.tile(np.eye(4), (2, 1, 1))


@dataclass(frozen=True, kw_only=True)
class CameraState(Immutable):
    """What is believed at one tick.

    Attributes:
        displacement: X_SC of the camera, S where its images say that it is.
        health: Of the camera's place.
        before: X_SC (4, 4) before the last jump.
        before: Covariance (6, 6) of X_SC before the last jump, which stays, in C.
        landmarks: With which the last jump is measured.
        since_jump: Ticks.
        motions: By what features were displaced at the last two ticks (2, 4, 4).
        features: Seen at this tick, where they are by that.
    """

    displacement: CameraDisplacement = field(default_factory=lambda: IN_PLACE)
    health: StreamHealth = HEALTHY
    before: Array = field(default_factory=lambda: np.zeros((6, 6)))
    landmarks: Landmarks = field(default_factory=Landmarks)
    since_jump: int = 0
    motions: Array = field(default_factory=_still)
    features: FeatureBelief = field(default_factory=no_features)


class CameraMotion(RecursiveFilter):
    """Tells a knock against the camera from motion in the scene, and finds where it stands then.

    A camera that is knocked sees all that rests, and all that moves, displaced at once by one rigid
    motion (`camera_jump`). From then on positions are those that the displaced camera sees; for
    some time, what rests is averaged and compared with where it rested before.

    For a camera that is fixed in the world but for that.

    Input ports:
    - `features_estimated`: `FeatureBelief` of this tick, positions in W as a camera sees them that
      is displaced as `camera_displacement_latest` says.
    - `features_predicted`: `ExpectedFeatures`, where the body tracker expects them at this tick.

    Output ports:
    - `features_estimated`: `FeatureBelief`, where they are with the camera where it is by now.
    - `camera_displacement_estimated`: `CameraDisplacement` X_SC of this tick.
    - `camera_displacement_latest`: the one of the last tick, from the state.
    - `health_latest`: `StreamHealth` as of the last tick; a fault since the camera has moved.

    Frames: W world, S where the camera is calibrated to be, C where it is.

    Args:
        config: When it is taken to have moved.
        dynamics: How the bodies accelerate that it sees.
        X_WS: (4, 4).

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self, config: CameraMotionConfig, dynamics: BodyDynamicsConfig, X_WS: Array
    ) -> None:
        super().__init__()
        check(config, "CameraMotion")
        self._config, self._dynamics = config, dynamics
        self._X_WS = np.array(X_WS, dtype=float)
        self._features = self._declare_value_input("features_estimated", no_features())
        self._expected = self._declare_value_input("features_predicted", no_expectations())
        self._declare_recursion(CameraState(), self._calc_state, config.period)
        self._declare_estimated("features_estimated", lambda state: state.features)
        self._declare_estimated("camera_displacement_estimated", lambda state: state.displacement)
        self._declare_latest("camera_displacement_latest", lambda state: state.displacement)
        self._declare_latest("health_latest", lambda state: state.health)

    def _calc_state(self, context: Context, state: CameraState) -> CameraState:
        features = self._read(self._features, context)
        expected = self._read_optional(self._expected, context) or no_expectations()
        return step(self._config, self._dynamics, state, features, expected, self._X_WS)


def step(
    config: CameraMotionConfig,
    dynamics: BodyDynamicsConfig,
    state: CameraState,
    features: FeatureBelief,
    expected: ExpectedFeatures,
    X_WS: Array,
) -> CameraState:
    """The state after the features of one tick."""
    state = replace(state, features=features)
    state = _after_jump(config, dynamics, state, expected, X_WS)
    state = replace(state, since_jump=state.since_jump + 1)
    return _settled(config, state, expected, X_WS)


def _after_jump(
    config: CameraMotionConfig,
    dynamics: BodyDynamicsConfig,
    state: CameraState,
    expected: ExpectedFeatures,
    X_WS: Array,
) -> CameraState:
    """The state with the camera where it is now, if it has just jumped."""
    features = state.features
    _, mine, theirs = np.intersect1d(features.ids, expected.ids, return_indices=True)
    known = expected.resting[theirs] | (expected.body[theirs] > STATIC_BODY)
    mine, theirs = mine[known], theirs[known]
    p, q = features.p_WF[mine], expected.p_WF[theirs]
    C = features.covariance[mine] + expected.covariance[theirs] + config.floor**2 * np.eye(3)
    if len(mine) < config.jump.least_features:
        return replace(state, motions=_still())
    before, last = state.motions
    apart, _ = squared_distances(p - q, C)
    if float(np.median(apart)) < _USUAL:
        return replace(state, motions=np.stack([last, np.eye(4)]))
    found, displaced = fit_displacement(p, q, C), apart > _GATE
    jumped = displaced & found.follows
    count = np.unique(expected.body[theirs][jumped], return_counts=True)[1]
    odds = jump_odds(
        config.jump,
        dynamics,
        found,
        displaced,
        int(np.sum(count >= _GROUP)),
        X_WS @ state.displacement.X,
        last @ se3.inverse(before) @ last,
        config.period,
    )
    # What moves may be jerked; a camera that is knocked sees what rests displaced, too.
    is_seen = np.sum(jumped & (expected.body[theirs] == STATIC_BODY)) >= _GROUP
    is_enough = is_seen and np.sum(jumped) >= config.jump.least_features
    if not is_enough or odds < np.log(config.jump.odds):
        return replace(state, motions=np.stack([last, found.Y]))
    rows = mine[found.follows], theirs[found.follows]
    walk = dynamics.linear_process_noise * config.period**3 / 3.0
    landmarks = _landmarks(features, expected, rows, walk, config.floor)
    place = state.displacement
    state = replace(
        state,
        displacement=replace(place, jumps=place.jumps + 1),
        before=place.covariance,
        landmarks=landmarks,
        since_jump=-1,
        motions=_still(),
    )
    state = _moved(state, found, X_WS)
    turn, shift = se3.log(state.displacement.X).reshape(2, 3)
    fault = (
        f"the camera has moved, by {np.rad2deg(np.linalg.norm(turn)):.1f} deg and"
        f" {1e3 * np.linalg.norm(shift):.0f} mm"
    )
    return replace(state, health=StreamHealth(fault=fault))


def _landmarks(
    features: FeatureBelief,
    expected: ExpectedFeatures,
    rows: tuple[Ids, Ids],
    walk: float,
    floor: float,
) -> Landmarks:
    """What a jump is measured by.

    What a body has accelerated since the last tick, all of its features have in common: each alone
    counts less, so that together they count as much as that allows.

    Args:
        features: At the tick of the jump.
        expected: Then.
        rows: Of the same ones in both.
        walk: Variance by which a body's acceleration shifts it within a tick, [m^2].
        floor: Error of a feature that averaging does not remove, [m].
    """
    mine, theirs = rows
    body = expected.body[theirs]
    moves = body > STATIC_BODY
    count = np.array([np.sum(body == own) for own in body], dtype=float)
    common = np.where(moves, count * walk, 0.0)[:, None, None] * np.eye(3)
    return Landmarks(
        ids=features.ids[mine],
        moves=moves,
        p_W=expected.p_WF[theirs],
        C=expected.covariance[theirs] + common + floor**2 * np.eye(3),
        information=np.zeros((len(mine), 3, 3)),
        moment=np.zeros((len(mine), 3)),
    )


def _moved(state: CameraState, found: Displacement, X_WS: Array) -> CameraState:
    """The state with the camera displaced so that what it sees is where it is expected."""
    Y_inverse = se3.inverse(found.Y)
    X_SC = se3.inverse(X_WS) @ Y_inverse @ X_WS @ state.displacement.X
    to_camera = se3.inverse(X_WS @ X_SC)
    about = np.eye(4)
    about[:3, 3] = found.centre
    Ad = se3.adjoint(to_camera @ about)
    R = Y_inverse[:3, :3]
    new = Ad @ found.covariance @ Ad.T
    displacement = replace(state.displacement, X=X_SC, covariance=state.before + new)
    if state.since_jump <= 0:
        displacement = replace(displacement, jump_covariance=new)
    seen = replace(
        state.features,
        p_WF=transform(Y_inverse, state.features.p_WF),
        covariance=R @ state.features.covariance @ R.T,
    )
    return replace(state, displacement=displacement, features=seen)


def _settled(
    config: CameraMotionConfig, state: CameraState, expected: ExpectedFeatures, X_WS: Array
) -> CameraState:
    """The state with the last jump measured by all that was seen of it until now."""
    landmarks, features = state.landmarks, state.features
    if len(landmarks.ids) == 0 or state.since_jump > whole_ticks(config.settling, config.period):
        return state
    _, mine, theirs = np.intersect1d(landmarks.ids, features.ids, return_indices=True)
    if state.since_jump > 0:
        still = ~landmarks.moves[mine]
        mine, theirs = mine[still], theirs[still]
    D = X_WS @ state.displacement.X @ se3.inverse(X_WS)  # From as if in S to where it is.
    R, information, moment = D[:3, :3], landmarks.information.copy(), landmarks.moment.copy()
    now = np.linalg.inv(R.T @ features.covariance[theirs] @ R)
    information[mine] += now
    moment[mine] += np.einsum("nij,nj->ni", now, transform(se3.inverse(D), features.p_WF[theirs]))
    state = replace(state, landmarks=replace(landmarks, information=information, moment=moment))
    moving = np.isin(landmarks.ids, expected.ids[expected.body != STATIC_BODY])
    rows = np.nonzero((information[:, 0, 0] > 0.0) & (landmarks.moves | ~moving))[0]
    if len(rows) < config.jump.least_features:
        return state
    C = np.linalg.inv(information[rows])
    seen = transform(D, np.einsum("nij,nj->ni", C, moment[rows]))
    C = R @ C @ R.T + landmarks.C[rows] + config.floor**2 * np.eye(3)
    return _moved(state, fit_displacement(seen, landmarks.p_W[rows], C), X_WS)
