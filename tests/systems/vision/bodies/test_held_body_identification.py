"""A body that vision found goes on as the held one, described in another frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.port_values import HELD_BODY, PoseBelief
from crossmodal.systems.vision.bodies import body_filter
from crossmodal.systems.vision.bodies.body_filter import BodyFilter
from crossmodal.systems.vision.bodies.body_tracker_state import RestPositions, TrackedBody
from crossmodal.systems.vision.bodies.held_body_identification import moved_frame, moves_with_hand
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig

T = se3.exp(np.array([0.3, -0.2, 0.1, 0.2, 0.1, -0.3]))
NOISE = np.tile(np.diag([1e-6, 2e-6, 4e-6]), (8, 1, 1))


def make_body() -> tuple[BodyFilter, np.ndarray]:
    rng = np.random.default_rng(3)
    X_WB = se3.exp(rng.normal(scale=0.3, size=6))
    body = body_filter.at_reference(X_WB, np.full(6, 0.05))
    p_WF = X_WB[:3, 3] + rng.normal(scale=0.1, size=(8, 3))
    body = body_filter.add_reference_landmarks(body, np.arange(8), X_WB, p_WF, NOISE)
    body = body_filter.predict(body, 0.1, np.full(6, 1e-3), 1e-5, turn_walk=1e-3)
    return body, p_WF + 1e-3 * rng.normal(size=(8, 3))


def test_features_stay_where_they_are_in_the_world() -> None:
    body, _ = make_body()
    moved = moved_frame(body, T)
    for old, new in ((body.p_BF, moved.p_BF), (body.p_BF_initial, moved.p_BF_initial)):
        assert_allclose(
            old @ body.X[:3, :3].T + body.X[:3, 3],
            new @ moved.X[:3, :3].T + moved.X[:3, 3],
            atol=1e-12,
        )


def test_it_does_not_matter_whether_the_frame_moves_before_or_after_a_correction() -> None:
    body, p_WF = make_body()
    landmarks = np.arange(8)
    first = moved_frame(body_filter.correct(body, landmarks, p_WF, NOISE), T)
    second = body_filter.correct(moved_frame(body, T), landmarks, p_WF, NOISE)
    assert_allclose(first.X, second.X, atol=1e-5)
    assert_allclose(first.P, second.P, atol=1e-8)
    assert_allclose(first.p_BF, second.p_BF, atol=1e-5)


def test_no_landmark_seems_to_have_drifted_because_the_frame_moved() -> None:
    body, _ = make_body()
    assert not body_filter.drifted(moved_frame(body, T), 16.27).any()


def tracked(body_id: int, way: float) -> TrackedBody:
    """A body that has moved by `way` [m] along x over the last ten ticks."""
    path = np.tile(np.eye(4), (20, 1, 1))
    path[-10:, 0, 3] = np.linspace(0.1, 1.0, 10) * way
    no_rest = RestPositions(
        ids=np.zeros(0, dtype=np.int64), p_WF=np.zeros((0, 3)), covariance=np.zeros((0, 3, 3))
    )
    filtered = body_filter.at_reference(path[-1], np.full(6, 0.01))
    filtered.P[:6, :6] = 1e-8 * np.eye(6)
    return TrackedBody(
        body_id=body_id,
        filter=filtered,
        X_WB_reference=np.eye(4),
        reference_tick=0,
        rest=no_rest,
        path=path,
    )


@pytest.mark.parametrize(("share", "held"), [(1.0, True), (0.8, True), (0.3, False), (0.0, False)])
def test_a_body_that_the_handle_drags_along_is_not_the_held_one(share: float, held: bool) -> None:
    way = 0.01
    X = np.eye(4)
    X[0, 3] = way
    sigma = np.repeat([0.05, 6e-3], 3)  # As the grip may still settle.
    prior = PoseBelief(X=X, covariance=np.diag(sigma**2))
    box, lid = tracked(2, share * way), tracked(HELD_BODY, 0.0)
    assert moves_with_hand(RigidBodyMotionConfig(), box, lid, prior, age=10) == held
