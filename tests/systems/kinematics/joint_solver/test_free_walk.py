"""The evidence of a free walk against one dense Gaussian of all poses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from maths import se3
from systems.kinematics.joint_solver import free_walk, pose_keyframes
from systems.kinematics.joint_solver.pose_keyframes import Keyframes

WALK = np.repeat([0.09, 0.01], 3)
NONE = np.zeros(7)
OUTLIERS = np.array([0.02, *np.repeat([1.0, 0.09], 3)])
R = 1e-6 * np.eye(6)


def _keyframes(shifts: np.ndarray, outliers: np.ndarray = NONE) -> Keyframes:
    """Poses that differ in translation only, so that the walk is linear."""
    kf = pose_keyframes.empty_keyframes(len(shifts))
    for k, shift in enumerate(shifts):
        X = np.eye(4)
        X[:3, 3] = shift
        pose_keyframes.append(kf, X, R, 0.1 * k, outliers)
    return kf


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_the_evidence_is_that_of_the_dense_problem(scale: float) -> None:
    rng = np.random.default_rng(0)
    shifts = np.cumsum(0.01 * rng.normal(size=(6, 3)), axis=0)
    kf, n = _keyframes(shifts), 6
    times = 0.1 * np.arange(n)
    found = free_walk.walk_at_scale(kf, WALK, scale, NONE, np.ones(n))
    expected = 0.0
    for axis in range(6):
        path = scale * WALK[axis] * np.minimum.outer(times, times)
        z = shifts[:, axis - 3] if axis >= 3 else np.zeros(n)
        # Given the first pose, whose place is not known before.
        C = (path + 1e-6 * np.eye(n))[1:, 1:] + 1e-6
        expected += multivariate_normal(cov=C).logpdf(z[1:] - z[0])
    own = -0.5 * kf.log_det[1:n].sum() - 3.0 * (n - 1) * np.log(2.0 * np.pi)
    assert_allclose(found, expected - own + 0.5 * kf.log_det[0], rtol=1e-6)


def test_a_pose_that_jumps_back_and_forth_is_an_outlier() -> None:
    inlier, shifts = np.ones(20), np.zeros((20, 3))
    shifts[10, 1] = 0.3
    free_walk.free_walk(_keyframes(shifts, OUTLIERS), WALK, OUTLIERS, inlier)
    assert inlier[10] < 0.1
    assert (np.delete(inlier, 10) > 0.9).all()


@pytest.mark.parametrize("scale", free_walk.SCALES)
def test_the_likeliest_scale_is_that_of_the_walk(scale: float) -> None:
    rng = np.random.default_rng(1)
    noise = np.repeat([1e-12, 0.01], 3)
    kf = _keyframes(np.cumsum(np.sqrt(scale * 0.01 * 0.1) * rng.normal(size=(40, 3)), axis=0))
    free_walk.free_walk(kf, noise, NONE, np.ones(40))
    assert kf.walk[1] == scale


def test_what_averaging_hides_is_remembered() -> None:
    """The evidence of rest over a walk is the same with few keyframes and with many."""
    rng = np.random.default_rng(2)
    poses = [se3.exp(1e-3 * rng.normal(size=6)) for _ in range(60)]
    found = []
    for capacity in (16, 64):
        kf = pose_keyframes.empty_keyframes(capacity)
        for k, X in enumerate(poses):
            if kf.size[0] == capacity:
                at, _ = pose_keyframes.choose(kf, 0.05)
                before = free_walk.walk_at_scale(kf, WALK, 1.0, NONE, np.ones(capacity))
                loss = pose_keyframes.merge(kf, at)
                after = free_walk.walk_at_scale(kf, WALK, 1.0, NONE, np.ones(capacity))
                kf.walk[0] += before - after + 0.5 * loss
            pose_keyframes.append(kf, X, R, k / 15.0, NONE)
        walk = free_walk.walk_at_scale(kf, WALK, 1.0, NONE, np.ones(capacity)) + kf.walk[0]
        n = int(kf.size[0])
        rest = -0.5 * sum(se3.log(kf.Z[k]) @ kf.W[k] @ se3.log(kf.Z[k]) for k in range(n))
        found.append(walk - rest)
    assert_allclose(found[0], found[1], rtol=0.2)
