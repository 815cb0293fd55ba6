"""The translation-invariant quaternion filter against closed forms and simulated statistics."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.systems.port_values import PosePrior
from crossmodal.systems.port_values.pose import deviations
from crossmodal.systems.pose.evidence import Evidence
from crossmodal.systems.pose.quaternion_filter import (
    QuaternionFilterConfig,
    filter_pose,
    measurement_matrices,
    measurement_noise,
    quaternion_prior,
    update_quaternion,
)
from crossmodal.systems.pose.target_model import TargetModel, make_target


def quaternion(R: np.ndarray) -> np.ndarray:
    return np.roll(Rotation.from_matrix(R).as_quat(), 1)


def rotation_covariance(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) of the rotation in O, of a quaternion (4,) with covariance (4, 4)."""
    w, v = x[0], x[1:]
    # x exp(phi / 2): the change of x by phi in O, half of it.
    skew = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    G = np.concatenate([-v[None], w * np.eye(3) + skew])
    return 4.0 * G.T @ covariance @ G


def test_exact_points_measure_zero() -> None:
    rng = np.random.default_rng(0)
    for R in Rotation.random(20, random_state=0).as_matrix():
        o = rng.normal(size=(10, 3))
        assert_allclose(measurement_matrices(o @ R.T, o) @ quaternion(R), 0.0, atol=1e-14)


def test_noise_is_that_of_a_simulation() -> None:
    rng = np.random.default_rng(1)
    R = Rotation.random(random_state=1).as_matrix()
    x, rho, o = quaternion(R), 4e-6, np.array([[0.1, -0.05, 0.2]])
    noisy = o @ R.T + np.sqrt(rho) * rng.normal(size=(40000, 3))
    measured = measurement_matrices(noisy, np.tile(o, (len(noisy), 1))) @ x
    found = measured.T @ measured / len(measured)
    expected = measurement_noise(x, np.zeros((4, 4)), rho)
    assert_allclose(found, expected, atol=0.03 * rho)
    assert_allclose(expected @ x, 0.0, atol=1e-12)


def test_centred_points_count_as_all_their_pairs() -> None:
    rng = np.random.default_rng(2)
    s, o = rng.normal(size=(2, 12, 3))
    H = measurement_matrices(s - s.mean(axis=0), o - o.mean(axis=0))
    centred = np.einsum("nki,nkj->ij", H, H)
    i, j = np.triu_indices(12, 1)
    pairs = measurement_matrices(s[j] - s[i], o[j] - o[i])
    assert_allclose(np.einsum("nki,nkj->ij", pairs, pairs), 12 * centred, rtol=1e-9, atol=1e-9)


def test_without_a_prior_it_is_the_least_squares_rotation() -> None:
    rng = np.random.default_rng(3)
    R = Rotation.random(random_state=3).as_matrix()
    o = rng.normal(size=(30, 3))
    s = o @ R.T + 0.05 * rng.normal(size=o.shape)
    s, o = s - s.mean(axis=0), o - o.mean(axis=0)
    expected, _ = Rotation.align_vectors(s, o)
    x0, covariance = quaternion(R), 1e6 * np.eye(4)
    for _ in range(20):  # The noise depends on x, whose direction is what counts.
        x, posterior = update_quaternion(
            x0, covariance, measurement_matrices(s, o), np.full(30, 0.005)
        )
        x0 = x
    found = Rotation.from_quat(np.roll(x, -1))
    assert (found.inv() * expected).magnitude() < 2e-3
    assert np.linalg.eigvalsh(posterior).min() > 0.0


def test_it_is_as_wrong_as_it_says() -> None:
    rng = np.random.default_rng(4)
    distances, sigma, prior_sigma = [], 2e-3, np.deg2rad(10.0)
    for R in Rotation.random(300, random_state=4).as_matrix():
        o = rng.uniform(-0.1, 0.1, (12, 3))
        s = o @ R.T + sigma * rng.normal(size=o.shape)
        start = R @ Rotation.from_rotvec(prior_sigma * rng.normal(size=3)).as_matrix()
        x0, covariance = quaternion_prior(start, prior_sigma)
        H = measurement_matrices(s - s.mean(axis=0), o - o.mean(axis=0))
        x = x0
        for _ in range(5):
            x, posterior = update_quaternion(x0, covariance, H, np.full(12, sigma**2), at=x)
        found = Rotation.from_quat(np.roll(x, -1)).as_matrix()
        e = Rotation.from_matrix(found.T @ R).as_rotvec()
        distances.append(e @ np.linalg.solve(rotation_covariance(x, posterior), e))
    assert 2.4 < np.mean(distances) < 3.8


@pytest.mark.parametrize("points", [0, 60, 400])
def test_a_pose_is_found_from_points_alone(points: int) -> None:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    model = make_target(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(5)
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    X[:3, 3] = [0.5, 0.1, 0.2]
    rows = rng.choice(len(model.surface.points), points, replace=False)
    p = model.surface.points[rows] @ X[:3, :3].T + X[:3, 3]
    evidence = Evidence().with_group(
        np.zeros((6, 0)),
        p + 5e-4 * rng.normal(size=p.shape),
        1e-3,
        model.surface.normals[rows] @ X[:3, :3].T,
    )
    start = X.copy()
    start[:3, :3] = X[:3, :3] @ Rotation.from_rotvec([0.1, -0.05, 0.1]).as_matrix()
    start[:3, 3] += [0.01, -0.01, 0.005]
    prior = PosePrior(X=start, rotation_sigma=0.15, translation_sigma=0.01)
    found = filter_pose(evidence, prior, model, QuaternionFilterConfig())
    moved = np.linalg.norm(found.X_WO[:3, 3] - X[:3, 3])
    if points == 0:
        assert_allclose(found.X_WO, start, atol=1e-9)
        assert_allclose(np.sqrt(np.diag(found.covariance)), [0.15] * 3 + [0.01] * 3, rtol=1e-6)
    else:
        assert moved < (2e-3 if points > 100 else 5e-3)
        more = filter_pose(evidence, prior, model, QuaternionFilterConfig(iterations=200))
        assert_array_equal(more.X, found.X)  # It had changed no more before the 100th iteration.
    errors = deviations(found.X, found.samples)
    whitened = np.linalg.solve(np.linalg.cholesky(found.covariance), errors.T)
    assert_allclose(np.mean(whitened**2), 1.0, atol=0.3)
    assert_array_equal(found.modes, found.X[None])
    assert_array_equal(found.middle, model.middle)


@pytest.fixture(scope="module")
def box() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def seen_from(direction: np.ndarray, X_WC: np.ndarray, rng: np.random.Generator) -> tuple:
    """Places (N, 3) on the sides of the box at X_WC that face a direction in W, and the normals."""
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    p, faces = trimesh.sample.sample_surface(mesh, 1200, seed=rng)
    p, n = np.asarray(p) @ X_WC[:3, :3].T + X_WC[:3, 3], mesh.face_normals[faces] @ X_WC[:3, :3].T
    return p[n @ direction > 0.0], n[n @ direction > 0.0]


def start(X: np.ndarray, rng: np.random.Generator) -> PosePrior:
    """A pose near X (4, 4), as wrong as it says."""
    wrong = X.copy()
    wrong[:3, :3] = X[:3, :3] @ Rotation.from_rotvec(0.1 * rng.normal(size=3)).as_matrix()
    wrong[:3, 3] += 0.01 * rng.normal(size=3)
    return PosePrior(X=wrong, rotation_sigma=0.1, translation_sigma=0.01)


DIRECTIONS = np.array([[1.0, 1.0, 0.5], [-1.0, 0.5, -0.5], [0.5, -1.0, 0.5]])


@pytest.mark.parametrize("views", [1, 3])
def test_it_is_as_wrong_as_it_says_with_a_surface(box: TargetModel, views: int) -> None:
    distances, sigma = [], 7e-4
    for trial in range(25):
        rng = np.random.default_rng(trial)
        X = np.eye(4)
        X[:3, :3] = Rotation.from_rotvec([0.2, -0.3, 0.4]).as_matrix()
        X[:3, 3] = [0.5, 0.1, 0.2]
        evidence = Evidence()
        # Each view is turned and moved by errors of its own.
        for number, errors in enumerate(rng.normal(size=(views, 6))):
            p, n = seen_from(DIRECTIONS[number], X, rng)
            A = np.zeros((6, 6 * views))
            A[:, 6 * number : 6 * number + 6] = np.diag(np.repeat([2e-3, 2e-3], 3))
            E = se3.exp(A[:, 6 * number : 6 * number + 6] @ errors)
            p = (p + sigma * rng.normal(size=p.shape)) @ E[:3, :3].T + E[:3, 3]
            evidence = evidence.with_group(A, p, sigma, n)
        config = QuaternionFilterConfig(starts=4)
        distances.append(filter_pose(evidence, start(X, rng), box, config).distance(X))
    assert 4.0 < np.mean(distances) < 8.5
    assert np.mean(np.array(distances) < 12.6) >= 0.84


def test_groups_displaced_against_each_other_turn_it_as_it_says(box: TargetModel) -> None:
    X, side = np.eye(4), np.array([1.0, 0.0, 0.0])
    p, n = seen_from(np.array([1.0, 1.0, 0.5]), X, np.random.default_rng(6))
    prior = PosePrior(X=X, rotation_sigma=0.2, translation_sigma=0.05)
    found = []
    for displaced in (0.0, 1.5e-3):
        evidence = Evidence()
        for half, sign in ((p[:, 2] > 0.0, 1.0), (p[:, 2] <= 0.0, -1.0)):
            v = sign * displaced * side
            A = np.concatenate([np.zeros(3), v])[:, None]
            evidence = evidence.with_group(A, p[half] + v, 7e-4, n[half])
        found.append(filter_pose(evidence, prior, box, QuaternionFilterConfig(starts=0)))
    still, moved = found
    turned = deviations(still.X, moved.X[None])[0, 1]
    variance = moved.covariance[1, 1] - still.covariance[1, 1]
    assert turned > np.deg2rad(0.5)
    assert_allclose(np.sqrt(variance), turned, rtol=0.15)
