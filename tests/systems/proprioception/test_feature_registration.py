"""Registration of features against known poses, with outliers; covariances by simulation."""

import numpy as np

from crossmodal.maths import se3
from crossmodal.systems.proprioception.feature_registration import register


def features(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a plate (count, 3) with covariances of their landmarks and of one frame."""
    p = rng.uniform(-0.2, 0.2, (count, 3)) * [0.1, 1.0, 1.0]
    landmarks = np.diag(np.tile([1e-6, 1e-6, 4e-6], count))
    noise = np.tile(np.diag([1e-6, 4e-6, 1e-6]), (count, 1, 1))
    return p, landmarks, noise


def test_exact_features_give_the_exact_pose() -> None:
    rng = np.random.default_rng(0)
    p, P, R = features(rng, 12)
    X = se3.exp(rng.normal(size=6))
    seen = p @ X[:3, :3].T + X[:3, 3]
    found, _, _, distance = register(X @ se3.exp(0.05 * rng.normal(size=6)), p, P, seen, R)
    np.testing.assert_allclose(found, X, atol=1e-4)
    assert np.all(distance < 1e-2)


def test_a_third_of_outliers_does_not_move_the_pose() -> None:
    rng = np.random.default_rng(1)
    p, P, R = features(rng, 24)
    X = se3.exp(0.3 * rng.normal(size=6))
    seen = p @ X[:3, :3].T + X[:3, 3] + 1e-3 * rng.normal(size=(24, 3))
    seen[:8] += [0.03, 0.02, -0.02]
    start = X @ se3.exp(np.array([0.02, 0, 0, 0.01, 0.0, 0.01]))
    found, _, _, distance = register(start, p, P, seen, R)
    assert np.linalg.norm(se3.log(se3.inverse(X) @ found)) < 0.01
    assert np.all(distance[:8] > 16.27)
    assert np.mean(distance[8:] < 16.27) > 0.9


def test_covariances_agree_with_simulated_errors() -> None:
    rng = np.random.default_rng(2)
    p, P, R = features(rng, 15)
    X = se3.exp(0.5 * rng.normal(size=6))
    values = []
    for _ in range(200):
        landmarks = p + np.sqrt(np.diag(P)).reshape(p.shape) * rng.normal(size=p.shape)
        seen = p @ X[:3, :3].T + X[:3, 3] + np.sqrt(np.diag(R[0])) * rng.normal(size=p.shape)
        found, white, common, _ = register(X, landmarks, P, seen, R)
        e = se3.log(se3.inverse(found) @ X)
        values.append(e @ np.linalg.solve(white + common, e))
    assert 5.3 < np.mean(values) < 6.9


def test_features_placed_at_a_wrong_pose_say_how_wrong_together() -> None:
    """Twenty of them tell that pose no better than one does: its error is in all of them."""
    rng = np.random.default_rng(4)
    p, P, R = features(rng, 20)
    J = np.hstack([np.vstack([-se3.skew(q) for q in p]), np.tile(np.eye(3), (20, 1))])
    pose = np.diag(np.repeat([0.02**2, 0.005**2], 3))
    _, _, common, _ = register(np.eye(4), p, P + J @ pose @ J.T, p.copy(), R)
    assert np.all(np.diag(common) > 0.95 * np.diag(pose))


def test_two_features_leave_a_rotation_unknown() -> None:
    p, P, R = features(np.random.default_rng(3), 2)
    _, white, _, _ = register(np.eye(4), p, P, p.copy(), R)
    assert np.linalg.eigvalsh(white)[-1] > 1.0
