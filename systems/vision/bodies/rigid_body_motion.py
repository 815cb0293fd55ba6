"""The system that turns moving point features into moving rigid bodies."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context, InputPort

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.pinhole import Intrinsics, project
from crossmodal.systems.port_values import (
    IN_PLACE,
    NO_POSE,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    BodyPredictions,
    CameraDisplacement,
    ExpectedFeatures,
    FeatureBelief,
    MotionBelief,
    PoseBelief,
    no_features,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.vision import camera_geometry
from crossmodal.systems.vision.bodies import body_tracking, feature_association, held_body
from crossmodal.systems.vision.bodies.body_initiation import initiate_body
from crossmodal.systems.vision.bodies.body_tracker_state import (
    BodyTrackerState,
    TrackedBody,
    no_bodies,
)
from crossmodal.systems.vision.bodies.feature_displacements import displacements
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory
from crossmodal.systems.vision.bodies.held_body_identification import identify_held_body
from crossmodal.systems.vision.bodies.rigid_body_motion_config import (
    RigidBodyMotionConfig,
    check_rigid_body_motion,
)


def advance_all(
    config: RigidBodyMotionConfig,
    state: BodyTrackerState,
    history: FeatureHistory,
    joints: BodyPredictions,
    prior: PoseBelief | None,
) -> tuple[list[TrackedBody], FeatureHistory]:
    """All bodies at this tick, the held one too, and the features with their rejections."""
    rejection_count = history.rejection_count.copy()
    bodies = []
    for body in state.bodies:
        predictions = [
            (p.source, p.pose.X) for p in joints.predictions if p.body_id == body.body_id
        ]
        if not held_body.is_held(body):
            moved, agreed, disagreed = body_tracking.advance(config, body, history, predictions)
        elif prior is not None and held_body.is_active(prior):
            moved, agreed, disagreed = held_body.advance(config, body, history, predictions, prior)
        else:
            continue
        rejection_count[agreed] = 0
        rejection_count[disagreed] += 1
        bodies.append(moved)
    history = replace(history, rejection_count=rejection_count)
    if prior is not None and held_body.is_active(prior) and held_body.find_held(bodies) is None:
        history = held_body.without_nudges(config, history)
        bodies.insert(0, held_body.start(config, prior, history, state.tick + 1))
    return bodies, history


def is_alive(config: RigidBodyMotionConfig, body: TrackedBody) -> bool:
    """Whether a body goes on; the held one does as long as the hand holds it."""
    return held_body.is_held(body) or body_tracking.is_supported(config, body)


def step(
    config: RigidBodyMotionConfig,
    state: BodyTrackerState,
    features: FeatureBelief,
    joints: BodyPredictions,
    prior: PoseBelief | None,
    camera: CameraDisplacement,
    X_WS: Array,
) -> BodyTrackerState:
    """One tick of all bodies.

    Args:
        config: Their parameters.
        state: At the last tick.
        features: Seen at this tick.
        joints: Where joints expect the bodies.
        prior: Where the hand takes the held body.
        camera: Where it is in S.
        X_WS: (4, 4).
    """
    tick = state.tick + 1
    if camera.jumps > state.camera_jumps:
        state = seen_from_elsewhere(state, camera, X_WS)
    history = body_tracking.remember_features(config, state, features)
    bodies, history = advance_all(config, state, history, joints, prior)
    bodies, history = identify_held_body(config, bodies, history, prior, tick)
    history = feature_association.associate(config, bodies, history)
    bodies, history = feature_association.merged(config, bodies, history)
    bodies, history, next_id = initiate_body(config, state, bodies, history, prior)
    living = [body for body in bodies if is_alive(config, body)]
    history = feature_association.reject_outliers(config, living, history)
    history = feature_association.reset_tracks(config, living, history)
    living = feature_association.without_outliers(config, living, history)
    living, history = body_tracking.place_landmarks(config, living, history)
    living, history = held_body.without_features_of_others(config, living, history, prior)
    return replace(state, tick=tick, next_id=next_id, history=history, bodies=living)


def seen_from_elsewhere(
    state: BodyTrackerState, camera: CameraDisplacement, X_WS: Array
) -> BodyTrackerState:
    """The bodies that a camera goes on seeing which has been knocked out of its place.

    What is not known of where it is now is a constant error of their poses from now on.
    """
    X_CW = se3.inverse(X_WS @ camera.X)

    def moved(body: TrackedBody) -> TrackedBody:
        Ad = se3.adjoint(se3.inverse(X_CW @ body.filter.X))
        offset = body.offset + Ad @ camera.jump_covariance @ Ad.T
        return replace(body, reset_count=body.reset_count + 1, offset=offset)

    bodies = [moved(body) for body in state.bodies]
    return replace(state, bodies=bodies, camera_jumps=camera.jumps)


def predicted_features(
    config: RigidBodyMotionConfig, state: BodyTrackerState, intrinsics: Array, X_CW: Array
) -> ExpectedFeatures:
    """Where the remembered features are expected at the next tick.

    Free ones where they were on average; assigned ones where their body's velocity takes them.
    """
    history = state.history
    window = history.p_W.shape[1]
    mean = displacements(history, newest=0, last_old=window - 1)
    p_WF = history.p_W[:, -1].copy()
    covariance = np.tile(1e-6 * np.eye(3), (len(history.ids), 1, 1))
    resting = (history.body == STATIC_BODY) & (history.rejection_count == 0) & (mean.count_old > 0)
    p_WF[resting] = mean.p_old[resting]
    covariance[resting] = mean.C_old[resting]
    for body in state.bodies:
        X_WB = body.filter.X
        X_WB_next = X_WB @ se3.exp(body.filter.V * config.period)
        mine = history.body == body.body_id
        p_BF = camera_geometry.transform(se3.inverse(X_WB), p_WF[mine])
        p_WF[mine] = camera_geometry.transform(X_WB_next, p_BF)
        _, landmarks, rows = np.intersect1d(body.filter.ids, history.ids, return_indices=True)
        p_WF[rows] = camera_geometry.transform(X_WB_next, body.filter.p_BF[landmarks])
    return ExpectedFeatures(
        ids=history.ids,
        uv=project(camera_geometry.transform(X_CW, p_WF), intrinsics),
        p_WF=p_WF,
        covariance=covariance,
        age=np.zeros(len(history.ids), np.int64),
        body=history.body,
        resting=resting,
    )


def body_motion(body: TrackedBody, age: float, assigned: Ids) -> BodyMotion:
    """What is reported of a body that stood at its reference `age` [s] ago.

    Args:
        assigned: All its features (L,).
    """
    covariance = body.filter.P[:12, :12].copy()
    covariance[:6, :6] += body.offset
    return BodyMotion(
        body_id=body.body_id,
        motion=MotionBelief(X=body.filter.X, V=body.filter.V, covariance=covariance),
        X_WB_reference=body.X_WB_reference,
        feature_ids=body.filter.ids,
        p_BF=body.filter.p_BF,
        p_BF_covariance=body.filter.landmark_covariance,
        correlated_covariance=body.filter.of_landmarks,
        reference_age=age,
        reset_count=body.reset_count,
        offset_covariance=body.offset,
        is_seen=body.unsupported == 0,
        assigned_ids=assigned,
    )


def body_motions(state: BodyTrackerState, period: float) -> BodyMotions:
    history = state.history
    return BodyMotions(
        bodies=[
            body_motion(
                body,
                period * (state.tick - body.reference_tick),
                history.ids[history.body == body.body_id],
            )
            for body in state.bodies
        ]
    )


class RigidBodyMotion(RecursiveFilter):
    """Finds rigid bodies B among the features F of a static world W and follows their motion.

    Each body has a Kalman filter over its pose, velocity and its features' constant positions,

        X_WB(t + dt) = X_WB(t) exp(V dt),    p_WF(t) = X_WB(t) p_BF + noise,

    started at the reference, the instant before it first moved, where its pose is known by
    definition and its features' positions are averages over the time before. Predictions of its
    pose (velocity, standing still, the kinematic model, the hand) are alternatives; the likeliest
    is corrected. A feature belongs to the body, or to the static world, that explains its
    displacement from earlier positions to the newest significantly better. Bodies are born when
    free features share a rigid motion that their covariances do not explain (RANSAC on the
    significant ones), and end when they have had no support for a while.

    With the held body, its prior's motion is one more hypothesis from the first tick on, so
    that features join it without RANSAC; its reference is the prior's pose at that tick.

    Input ports:
    - `features_estimated`: `FeatureBelief`, the features seen at this tick, positions in W.
    - `joint_predictions`: `BodyPredictions` of X_WB at this tick; none if not connected.
    - `camera_displacement`: `CameraDisplacement` X_SC; the camera has stayed where it was if not
      connected.
    - `held_body_prior`: `PoseBelief` X_WB of `HELD_BODY`, not finite while there is
      none; only declared with `with_held_body`.

    Output ports:
    - `body_motions_estimated`: `BodyMotions`, posterior of this tick; vision's own bodies are
      numbered from 2; B has W's axes at the features' centroid at the reference. The covariance is
      that of the displacement since then, the errors of p_BF included.
    - `body_motions_latest`: the same of the last tick, from the state.
    - `features_predicted`: `ExpectedFeatures` at the next tick, from the state: every remembered
      feature, by id; `uv` projected into a camera that is assumed to stand still, `age` zero.

    Source: the role is that of Martín-Martín and Brock, IROS 2017, sections III and V;
    filter and tests are our own.
    """

    def __init__(
        self,
        config: RigidBodyMotionConfig,
        camera: Intrinsics,
        X_WS: Array,
        with_held_body: bool = False,
    ) -> None:
        super().__init__()
        check_rigid_body_motion(config)
        self._config = config
        self._intrinsics = camera.vector()
        self._X_WS = np.array(X_WS, dtype=float)

        self._features = self._declare_value_input("features_estimated", no_features())
        self._joints = self._declare_value_input("joint_predictions", BodyPredictions())
        self._camera = self._declare_value_input("camera_displacement", IN_PLACE)
        self._prior: InputPort | None = None
        if with_held_body:
            self._prior = self._declare_value_input("held_body_prior", NO_POSE)
        self._declare_recursion(no_bodies(config), self._calc_bodies, config.period)
        self._declare_estimated("body_motions_estimated", self._motions)
        self._declare_latest("body_motions_latest", self._motions)
        self._declare_latest("features_predicted", self._predicted)

    def _calc_bodies(self, context: Context, state: BodyTrackerState) -> BodyTrackerState:
        features = self._read(self._features, context)
        joints = self._read_optional(self._joints, context) or BodyPredictions()
        prior = self._read_optional(self._prior, context)
        camera = self._read_optional(self._camera, context) or IN_PLACE
        return step(self._config, state, features, joints, prior, camera, self._X_WS)

    def _motions(self, state: BodyTrackerState) -> BodyMotions:
        return body_motions(state, self._config.period)

    def _predicted(self, state: BodyTrackerState) -> ExpectedFeatures:
        return predicted_features(self._config, state, self._intrinsics, se3.inverse(self._X_WS))
