"""A body that vision found goes on as the interacted one, described in another frame."""

import numpy as np
from numpy.testing import assert_allclose

from maths import se3
from systems.vision import body_filter
from systems.vision.body_adoption import moved_frame
from systems.vision.body_filter import BodyFilter

T = se3.exp(np.array([0.3, -0.2, 0.1, 0.2, 0.1, -0.3]))
NOISE = np.tile(np.diag([1e-6, 2e-6, 4e-6]), (8, 1, 1))


def make_body() -> tuple[BodyFilter, np.ndarray]:
    rng = np.random.default_rng(3)
    X_WB = se3.exp(rng.normal(scale=0.3, size=6))
    body = body_filter.at_reference(X_WB, np.full(6, 0.05))
    p_WF = X_WB[:3, 3] + rng.normal(scale=0.1, size=(8, 3))
    body = body_filter.add_rest_anchors(body, np.arange(8), X_WB, p_WF, NOISE)
    body = body_filter.predict(body, 0.1, np.full(6, 1e-3), 1e-5, turn_walk=1e-3)
    return body, p_WF + 1e-3 * rng.normal(size=(8, 3))


def test_features_stay_where_they_are_in_the_world() -> None:
    body, _ = make_body()
    moved = moved_frame(body, T)
    for old, new in ((body.p_BF, moved.p_BF), (body.p_BF_first, moved.p_BF_first)):
        assert_allclose(
            old @ body.X[:3, :3].T + body.X[:3, 3],
            new @ moved.X[:3, :3].T + moved.X[:3, 3],
            atol=1e-12,
        )


def test_it_does_not_matter_whether_the_frame_moves_before_or_after_a_correction() -> None:
    body, p_WF = make_body()
    anchors = np.arange(8)
    first = moved_frame(body_filter.correct(body, anchors, p_WF, NOISE), T)
    second = body_filter.correct(moved_frame(body, T), anchors, p_WF, NOISE)
    assert_allclose(first.X, second.X, atol=1e-5)
    assert_allclose(first.P, second.P, atol=1e-8)
    assert_allclose(first.p_BF, second.p_BF, atol=1e-5)


def test_no_anchor_seems_to_have_drifted_because_the_frame_moved() -> None:
    body, _ = make_body()
    assert not body_filter.drifted(moved_frame(body, T), 16.27).any()
