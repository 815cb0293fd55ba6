"""The group laws of SE(3), near zero and near pi, against SciPy and finite differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from crossmodal.maths import se3

ANGLES = [0.0, 1e-9, 1e-5, 0.99e-4, 1.01e-4, 0.0099, 0.0101, 0.5, 2.0, np.pi - 1e-3, np.pi - 1e-7]


def tangent(angle: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    return np.concatenate([angle * axis / np.linalg.norm(axis), rng.normal(size=3)])


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", range(3))
def test_exp_agrees_with_scipy_and_log_inverts_it(angle: float, seed: int) -> None:
    xi = tangent(angle, seed)
    X = se3.exp(xi)
    assert_allclose(X, RigidTransform.from_exp_coords(xi).as_matrix(), atol=1e-10)
    assert_allclose(se3.log(X), xi, atol=2e-8)


@pytest.mark.parametrize("angle", ANGLES)
def test_jacobians_agree_with_finite_differences(angle: float) -> None:
    xi = tangent(angle, 7)
    h = 1e-6
    X_inverse = se3.inverse(se3.exp(xi))
    left, right = np.empty((6, 6)), np.empty((6, 6))
    for i, d in enumerate(np.eye(6) * h):
        plus, minus = se3.exp(xi + d), se3.exp(xi - d)
        left[:, i] = (se3.log(plus @ X_inverse) - se3.log(minus @ X_inverse)) / (2 * h)
        right[:, i] = (se3.log(X_inverse @ plus) - se3.log(X_inverse @ minus)) / (2 * h)
    assert_allclose(se3.left_jacobian(xi), left, atol=2e-7)
    assert_allclose(se3.right_jacobian(xi), right, atol=2e-7)


@pytest.mark.parametrize("angle", ANGLES)
def test_adjoint_moves_a_tangent_through_a_pose(angle: float) -> None:
    X, xi = se3.exp(tangent(angle, 1)), tangent(0.3, 2)
    assert_allclose(X @ se3.exp(xi), se3.exp(se3.adjoint(X) @ xi) @ X, atol=1e-9)
    assert_allclose(X @ se3.inverse(X), np.eye(4), atol=1e-12)


def test_bracket_is_how_an_adjoint_changes() -> None:
    V, xi, h = tangent(0.7, 4), tangent(0.3, 5), 1e-6
    change = (se3.adjoint(se3.exp(h * V)) - se3.adjoint(se3.exp(-h * V))) / (2 * h)
    assert_allclose(se3.bracket(V), change, atol=1e-9)
    assert_allclose(se3.bracket(V) @ xi, -se3.bracket(xi) @ V, atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotations_are_those_of_scipy(angle: float) -> None:
    omega = tangent(angle, 3)[:3]
    R = se3.so3_exp(omega)
    assert_allclose(R, Rotation.from_rotvec(omega).as_matrix(), atol=1e-12)
    assert_allclose(se3.so3_log(R), omega, atol=2e-8)


def test_a_camera_looks_at_its_target_with_its_top_up() -> None:
    eye, target = np.array([0.1, 0.4, 1.4]), np.array([0.8, -0.3, 0.9])
    X = se3.looking_at(eye, target)
    assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)
    assert_allclose(X[:3, 3], eye)
    assert_allclose(X[:3, 2], (target - eye) / np.linalg.norm(target - eye))
    assert X[2, 1] < 0.0
    assert_allclose(X[2, 0], 0.0, atol=1e-12)
    down = se3.looking_at(eye, eye - [0, 0, 1], np.array([1.0, 0.0, 0.0]))
    assert_allclose(down[:3, 1], [-1, 0, 0], atol=1e-12)


def test_a_camera_that_looks_straight_down_needs_no_direction_up() -> None:
    eye = np.array([0.5, 0.0, 0.6])
    X = se3.looking_at(eye, eye - [0.0, 0.0, 0.4])
    assert_allclose(X[:3, 2], [0.0, 0.0, -1.0])
    assert_allclose(X[:3, 1], [0.0, -1.0, 0.0])
