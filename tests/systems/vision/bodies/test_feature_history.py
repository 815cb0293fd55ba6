"""What is remembered of features, and their displacements relative to moving frames."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import FeatureBelief
from crossmodal.systems.vision.bodies.feature_displacements import displacements, squared_distances
from crossmodal.systems.vision.bodies.feature_history import (
    OUTLIER,
    FeatureHistory,
    no_history,
    remember,
)

RNG = np.random.default_rng(0)
WINDOW = 12


def belief(ids: list[int], p_WF: Array, sigma: float = 1e-3) -> FeatureBelief:
    count = len(ids)
    return FeatureBelief(
        ids=np.array(ids, dtype=np.int64),
        uv=np.zeros((count, 2)),
        p_WF=np.asarray(p_WF, float),
        covariance=np.tile(sigma**2 * np.eye(3), (count, 1, 1)),
        age=np.zeros(count, np.int64),
    )


def grow(beliefs: list[FeatureBelief], **options: float) -> FeatureHistory:
    settings = {"floor": 0.0, "memory": 5, "rest_samples": 1e9} | options
    history = no_history(WINDOW)
    for tick, features in enumerate(beliefs):
        history = remember(history, features, tick, **settings)
    return history


def test_ids_are_sorted_and_samples_belong_to_their_feature() -> None:
    history = grow([belief([7, 2], [[7, 0, 0], [2, 0, 0]]), belief([5, 2], [[5, 0, 1], [2, 0, 1]])])
    assert history.ids.tolist() == [2, 5, 7]
    assert_allclose(history.p_W[:, -1, 0], [2, 5, 7])
    assert history.seen.tolist() == [True, True, False]
    assert history.samples[:, -2:].tolist() == [[True, True], [False, True], [True, False]]


def test_a_feature_unseen_for_long_is_forgotten() -> None:
    history = grow([belief([1, 2], np.zeros((2, 3)))] + [belief([2], np.zeros((1, 3)))] * 6)
    assert history.ids.tolist() == [2]


def test_samples_that_leave_the_window_average_into_the_rest() -> None:
    p = RNG.normal(size=(40, 1, 3))
    history = grow([belief([3], sample) for sample in p])
    d = displacements(history, newest=0, last_old=WINDOW - 1)
    assert_allclose(d.p_old[0], p.mean(axis=(0, 1)), atol=1e-9)
    assert_allclose(d.C_old[0], 1e-6 / 40 * np.eye(3), rtol=1e-6)
    assert history.rest_until[0] == 40 - WINDOW - 1


def test_displacements_vanish_in_the_frame_that_carries_the_features() -> None:
    p_BF = RNG.normal(size=(6, 3))
    steps = [se3.exp(0.02 * k * np.array([1.0, -2, 0.5, 0.3, 0.1, -0.2])) for k in range(WINDOW)]
    path = np.array(steps)
    history = grow([belief(list(range(6)), p_BF @ X[:3, :3].T + X[:3, 3]) for X in path])
    d = displacements(history, newest=3, X_WB=path)
    assert_allclose(d.p_new, p_BF, atol=1e-9)
    assert_allclose(d.p_old, p_BF, atol=1e-9)
    assert d.count_new.tolist() == [3] * 6
    assert d.count_old.tolist() == [WINDOW - 3] * 6
    still = displacements(history, newest=3)
    assert np.linalg.norm(still.p_new - still.p_old, axis=1).min() > 0.01


def test_a_still_path_and_no_path_give_the_same() -> None:
    history = grow([belief([1, 2], RNG.normal(size=(2, 3))) for _ in range(20)])
    first = displacements(history, newest=3)
    second = displacements(history, newest=3, X_WB=np.tile(np.eye(4), (WINDOW, 1, 1)))
    for name, value in vars(first).items():
        assert_allclose(value, vars(second)[name], atol=1e-12)


def test_only_free_features_rest() -> None:
    samples = [belief([1], RNG.normal(size=(1, 3))) for _ in range(WINDOW)]
    history = grow(samples)
    history.body[:] = OUTLIER
    later = remember(
        history, belief([1], np.zeros((1, 3))), WINDOW, floor=0.0, memory=5, rest_samples=60
    )
    assert later.rest_until[0] == -1


def test_squared_distances_are_mahalanobis() -> None:
    A = RNG.normal(size=(4, 3, 3))
    S, e = A @ A.transpose(0, 2, 1) + np.eye(3), RNG.normal(size=(4, 3))
    distance, log_determinant = squared_distances(e, S)
    for i in range(4):
        assert_allclose(distance[i], e[i] @ np.linalg.solve(S[i], e[i]))
        assert_allclose(log_determinant[i], np.log(np.linalg.det(S[i])))
