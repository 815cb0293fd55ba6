"""The bounded memory of poses against the Lie group and plain averages."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.kinematics.keyframes import pose_keyframes
from crossmodal.systems.kinematics.keyframes.measurement_noise import UNKNOWN
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes

OUTLIERS = np.zeros(7)  # None.


def _fill(poses: np.ndarray, R: np.ndarray, capacity: int = 32) -> Keyframes:
    kf = pose_keyframes.empty_keyframes(capacity, 6)
    for k, X in enumerate(poses):
        if kf.size[0] == capacity:
            at, average = pose_keyframes.choose(kf, 0.05, np.ones(capacity))
            if average:
                pose_keyframes.merge(kf, at, np.zeros(3))
            else:
                pose_keyframes.remove(kf, at)
        pose_keyframes.append(kf, X, R, k / 15.0, OUTLIERS)
    return kf


def test_the_mean_of_two_poses_on_a_screw_is_on_the_screw_at_the_mean_time() -> None:
    screw = np.array([0.0, 0.0, 1.0, 0.3, -0.2, 0.1])
    kf = _fill(np.array([se3.exp(q * screw) for q in (0.0, 0.4, 1.6)]), 1e-6 * np.eye(6))
    pose_keyframes.merge(kf, 1, np.zeros(3))
    assert_allclose(kf.Z[1], se3.exp(1.0 * screw), atol=1e-12)
    assert_allclose(kf.time[1], 1.5 / 15.0)
    assert_allclose(kf.R[1], 0.5e-6 * np.eye(6))


def test_the_mean_of_two_positions_is_on_the_arc_by_which_the_child_has_turned() -> None:
    R = np.diag(np.repeat([UNKNOWN, 1e-6], 3))
    hinge = np.array([0.0, 0.0, 1.0, 0.4, 0.0, 0.0])
    positions = np.tile(np.eye(4), (3, 1, 1))
    for X, q in zip(positions, (0.0, 0.4, 1.2), strict=True):
        X[:3, 3] = se3.exp(q * hinge)[:3, 3]
    kf = _fill(positions, R)
    pose_keyframes.merge(kf, 1, np.array([0.0, 0.0, 0.8]))
    assert_allclose(kf.Z[1, :3, 3], se3.exp(0.8 * hinge)[:3, 3], atol=1e-12)
    assert_allclose(kf.Z[1, :3, :3], np.eye(3))


@pytest.mark.parametrize("floor", [0.0, 1e-4])
def test_a_less_certain_pose_counts_less_in_the_mean(floor: float) -> None:
    """By its noise alone: how far both deviate from an ideal path is nothing that averages out."""
    kf = pose_keyframes.empty_keyframes(4, 6)
    pose_keyframes.append(kf, np.eye(4), np.eye(6), 0.0, OUTLIERS)
    for x, variance in ((0.0, 1e-6), (1.0, 3e-6)):
        X = np.eye(4)
        X[0, 3] = x
        pose_keyframes.append(kf, X, variance * np.eye(6), x, OUTLIERS)
    pose_keyframes.rescale(kf, np.ones(6), floor * np.eye(6), OUTLIERS)
    pose_keyframes.merge(kf, 1, np.zeros(3))
    assert_allclose(kf.Z[1, 0, 3], 0.25)
    assert_allclose(kf.R[1], 0.75e-6 * np.eye(6), atol=1e-18)


def test_a_body_at_rest_is_averaged_without_loss() -> None:
    rng = np.random.default_rng(1)
    noise = 1e-3 * rng.normal(size=(3000, 6))
    kf = _fill(np.array([se3.exp(n) for n in noise]), 1e-6 * np.eye(6))
    n = int(kf.size[0])
    weights = np.array([1.0 / kf.R[k, 0, 0] for k in range(n)])
    mean = np.array([se3.log(kf.Z[k]) for k in range(n)]).T @ weights / weights.sum()
    assert_allclose(weights.sum(), 3000e6, rtol=1e-9)
    assert_allclose(mean, noise.mean(axis=0), atol=2e-6)


@pytest.mark.parametrize("speed", [0.0, 1e-4])
def test_keyframes_are_as_far_off_the_path_as_noise_makes_their_means(speed: float) -> None:
    """Neighbours that noise has made alike are no reason for averaging them."""
    rng, sigma, squares = np.random.default_rng(0), 1e-3, []
    for _ in range(20):
        path = np.tile(np.eye(4), (200, 1, 1))
        path[:, 0, 3] = speed * np.arange(200)
        measured = np.array([X @ se3.exp(sigma * rng.normal(size=6)) for X in path])
        kf = _fill(measured, sigma**2 * np.eye(6), capacity=24)
        for k in range(1, int(kf.size[0])):
            X = np.eye(4)
            X[0, 3] = speed * kf.time[k] * 15.0
            e = se3.log(se3.inverse(X) @ kf.Z[k])
            squares.append(e @ np.linalg.solve(kf.R[k], e))
    assert 0.9 < np.mean(squares) / 6.0 < 1.15


def test_memory_is_bounded_and_motion_is_kept_in_even_steps() -> None:
    X = np.tile(np.eye(4), (600, 1, 1))
    X[300:, 0, 3] = np.linspace(0.0, 0.3, 300)  # Ten seconds at rest first.
    kf = _fill(X, 1e-6 * np.eye(6))
    assert kf.size[0] == 32
    moving = kf.Z[: kf.size[0] - pose_keyframes.RECENT, 0, 3]
    assert (moving > 0.01).sum() >= 22
    assert np.diff(moving).max() < 0.03


def test_the_first_keyframe_is_never_averaged() -> None:
    kf = _fill(np.tile(np.eye(4), (200, 1, 1)), 1e-6 * np.eye(6))
    assert_allclose(kf.R[0], 1e-6 * np.eye(6))
    assert kf.time[0] == 0.0


def test_to_and_fro_for_long_marginalises_keyframes_instead_of_averaging_the_motion_away() -> None:
    X = np.tile(np.eye(4), (4500, 1, 1))
    X[:, 0, 3] = 0.1 * np.sin(2.0 * np.pi * np.arange(4500) / 120.0)
    kf = _fill(X, 1e-6 * np.eye(6))
    spread = np.std(kf.Z[: kf.size[0], 0, 3])
    assert spread > 0.6 * 0.1 / np.sqrt(2.0)


def test_a_measurement_that_is_likely_an_outlier_counts_little_in_the_mean() -> None:
    kf = pose_keyframes.empty_keyframes(4, 6)
    outliers = np.array([0.02, *np.repeat([1.0, 0.09], 3)])
    X = np.eye(4)
    for k, x in enumerate((0.0, 0.0, 0.05)):
        X[0, 3] = x
        pose_keyframes.append(kf, X, 1e-6 * np.eye(6), k / 15.0, outliers)
    assert kf.undecided[:3].all()
    pose_keyframes.fix(kf, 2, 1e-9)
    assert not kf.undecided[2]
    assert_allclose(np.diag(kf.R[2])[3:], 0.09, rtol=1e-2)
    pose_keyframes.merge(kf, 1, np.zeros(3))
    assert abs(kf.Z[1, 0, 3]) < 1e-4


def test_what_is_an_outlier_is_averaged_at_once_and_what_may_be_none_at_last() -> None:
    kf = pose_keyframes.empty_keyframes(12, 6)
    outliers = np.array([0.02, *np.repeat([1.0, 0.09], 3)])
    rng, at = np.random.default_rng(0), 4
    for k in range(12):
        X = se3.exp(1e-3 * rng.normal(size=6))
        X[0, 3] += 0.05 if k == at else 0.0
        pose_keyframes.append(kf, X, 1e-6 * np.eye(6), k / 15.0, outliers)
    inlier = np.ones(12)
    assert pose_keyframes.choose(kf, 0.05, inlier)[0] not in (at - 1, at)
    inlier[at] = 1e-9
    assert pose_keyframes.choose(kf, 0.05, inlier)[0] in (at - 1, at)


def test_scale_and_floor_change_what_the_keyframes_know() -> None:
    kf = _fill(np.tile(np.eye(4), (3, 1, 1)), 1e-6 * np.eye(6))
    pose_keyframes.rescale(kf, np.repeat([2.0, 3.0], 3), 1e-5 * np.eye(6), OUTLIERS)
    assert_allclose(np.diag(kf.R[1]), np.repeat([4e-6, 9e-6], 3))
    assert_allclose(kf.W[1], np.linalg.inv(kf.R[1] + 1e-5 * np.eye(6)))
    assert_allclose(kf.log_det[1], np.linalg.slogdet(kf.R[1] + 1e-5 * np.eye(6))[1])


@pytest.mark.parametrize("deviations", [0.0, 1.0])
def test_an_exact_reference_has_no_floor(deviations: float) -> None:
    kf = pose_keyframes.empty_keyframes(4, 6)
    kf.reference_deviates[0] = deviations
    for k in range(2):
        pose_keyframes.append(kf, np.eye(4), 1e-6 * np.eye(6), float(k), OUTLIERS)
    pose_keyframes.rescale(kf, np.ones(6), 1e-5 * np.eye(6), OUTLIERS)
    for k, share in ((0, deviations), (1, 1.0)):
        assert_allclose(kf.W[k], np.linalg.inv((1e-6 + share * 1e-5) * np.eye(6)))
