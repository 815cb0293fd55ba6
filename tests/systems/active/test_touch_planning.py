"""Predicted contacts, and what they are worth, against simulation."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.systems.active.touch_planning import (
    CRITERIA,
    TouchConfig,
    TouchPredictions,
    candidate_rays,
    expected_squared_distance,
    predict_touches,
)
from crossmodal.systems.port_values import ObjectPose
from crossmodal.systems.pose.target_model import TargetModel, cast_rays, make_target

CONFIG = TouchConfig()


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def believed(model: TargetModel, sigma: np.ndarray, seed: int = 0) -> ObjectPose:
    """A Gaussian about an upright pose with standard deviations (6,)."""
    rng = np.random.default_rng(seed)
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, 0.1]
    samples = np.tile(X, (64, 1, 1))
    for n, e in enumerate(sigma * rng.normal(size=(64, 6))):
        samples[n, :3, :3] = se3.so3_exp(e[:3])
        samples[n, :3, 3] += e[3:]
    return ObjectPose(
        X=X,
        covariance=np.diag(sigma**2),
        joint=np.diag(sigma**2),
        samples=samples,
        calibration=np.zeros((64, 0)),
        modes=X[None],
        probabilities=np.ones(1),
        middle=model.middle,
    )


SURE = np.repeat([1e-4, 1e-4], 3)
DOUBTFUL = np.repeat([0.15, 0.02], 3)


def predicted(
    model: TargetModel, sigma: np.ndarray, count: int = 200, up: bool = True
) -> TouchPredictions:
    belief, rng = believed(model, sigma), np.random.default_rng(1)
    height = 0.0 if up else -np.inf
    rays = candidate_rays(belief, model, CONFIG, count, rng, height=height)
    return predict_touches(belief, model, *rays, CONFIG, rng)


def test_candidates_come_from_all_sides_but_from_below(model: TargetModel) -> None:
    rays = predicted(model, SURE, 400)
    starts, directions = rays.starts, rays.directions
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, -1.0)):
        assert np.any(directions[:, axis] * sign > 0.99)
    assert not np.any(directions[:, 2] > 0.5)
    assert starts[:, 2].min() > CONFIG.clearance
    assert_allclose(np.linalg.norm(directions, axis=1), 1.0)


def test_what_is_sure_to_be_met_head_on_is_feasible(model: TargetModel) -> None:
    rays = predicted(model, SURE)
    assert rays.feasible(CONFIG).mean() > 0.9
    assert_allclose(rays.distances[:, rays.feasible(CONFIG)], CONFIG.standoff, atol=2e-3)
    assert predicted(model, DOUBTFUL).feasible(CONFIG).mean() < 0.7


def test_rows_are_derivatives_of_the_distance(model: TargetModel) -> None:
    rays = predicted(model, np.repeat([0.05, 5e-3], 3), 20)
    k, step = 3, 1e-5
    X = rays.poses[k]
    met = np.isfinite(rays.distances[k])
    at = rays.starts + np.where(met, rays.distances[k], 0.0)[:, None] * rays.directions
    for axis in range(6):
        e = step * np.eye(6)[axis]
        Y = X.copy()
        Y[:3, :3] = X[:3, :3] @ se3.so3_exp(e[:3])
        Y[:3, 3] += e[3:]
        p, d = (rays.starts - Y[:3, 3]) @ Y[:3, :3], rays.directions @ Y[:3, :3]
        reach = np.full(len(p), 1.0)
        found, samples = cast_rays(
            np.ascontiguousarray(p), np.ascontiguousarray(d), reach, model.surface, False
        )
        n = model.surface.normals[samples]
        same = met & np.isfinite(found)
        on_surface = p + np.where(same, found, 0.0)[:, None] * d
        # By how far the point that was met lies outside of the moved surface.
        height = np.einsum("ri,ri->r", (at - Y[:3, 3]) @ Y[:3, :3] - on_surface, n)
        assert_allclose(height[same] / step, rays.rows[k, same, axis], atol=2e-3)


@pytest.mark.parametrize("name", ["log-det", "expected-adi"])
def test_what_nobody_doubts_teaches_nothing(model: TargetModel, name: str) -> None:
    """Only the position along x is unknown, so that only faces across x teach anything."""
    sigma = np.full(6, 1e-6)
    sigma[3] = 5e-3
    rays = predicted(model, sigma)
    gains = CRITERIA[name](rays, model, 1e-3, np.random.default_rng(0))
    along = np.abs(rays.directions[:, 0]) > 0.99
    assert np.median(gains[along]) > 1000.0 * np.median(gains[~along])


def test_the_gain_is_the_fall_of_the_squared_distance(model: TargetModel) -> None:
    sigma, noise = np.array([0.02, 0.01, 0.03, 4e-3, 2e-3, 3e-3]), 1e-3
    rays = predicted(model, sigma, 30)
    rays = TouchPredictions(
        **{**vars(rays), "poses": np.tile(believed(model, sigma).X, (16, 1, 1))}
    )
    gains = CRITERIA["expected-adi"](rays, model, noise, np.random.default_rng(0))
    points, normals = model.surface.points, model.surface.normals
    J = np.concatenate([-np.cross(points, normals), -normals], axis=1)
    C, expected = np.diag(sigma**2), []
    for ray in range(len(gains)):
        of_ray = []
        for k in range(16):
            j = rays.rows[k, ray]
            after = C - np.outer(C @ j, C @ j) / (noise**2 + j @ C @ j)
            of_ray.append(np.mean(np.einsum("ni,ij,nj->n", J, C - after, J)))
        expected.append(np.mean(of_ray))
    assert_allclose(gains, expected, rtol=1e-6)


def test_the_squared_distance_is_that_of_small_displacements(model: TargetModel) -> None:
    """Of many poses at once, and the same as the mean over displaced surfaces."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    C = np.diag(np.array([0.02, 0.01, 0.03, 4e-3, 2e-3, 3e-3]) ** 2)
    found = expected_squared_distance(np.array([C, 4.0 * C]), np.array([pose, pose]), model)
    assert found.shape == (2,)
    assert found[1] == pytest.approx(4.0 * found[0])
    e = np.random.default_rng(0).multivariate_normal(np.zeros(6), C, 400)
    points, normals = model.surface.points, model.surface.normals
    moves = np.cross(e[:, None, :3], points) + (e[:, 3:] @ pose[:3, :3])[:, None]
    squared = np.mean(np.sum(moves * normals, axis=2) ** 2)
    assert found[0] == pytest.approx(squared, rel=0.15)
