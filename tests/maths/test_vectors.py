"""Cross products against NumPy, and the basis of a tangent plane."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal.maths.vectors import cross, normal_basis, transport


@pytest.mark.parametrize("seed", range(5))
def test_the_cross_product_is_that_of_numpy(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    assert_allclose(cross(a, b), np.cross(a, b))


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [0, -1.0, 0], [1.0, 0, 0], [0.6, 0.0, 0.8]])
def test_the_tangent_basis_is_orthonormal_and_right_handed_with_the_axis(axis: list[float]) -> None:
    B = normal_basis(np.array(axis))
    assert_allclose(np.vstack([B, axis]) @ np.vstack([B, axis]).T, np.eye(3), atol=1e-15)
    assert_allclose(np.cross(axis, B[0]), B[1], atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.1, 1.5])
def test_tangent_vectors_are_turned_by_the_least_rotation(angle: float) -> None:
    rng, Q = np.random.default_rng(0), np.empty((2, 2))
    for _ in range(20):  # In some of them another component is the smallest afterwards.
        a, w = rng.normal(size=(2, 3))
        a /= np.linalg.norm(a)
        w = np.cross(a, w) / np.linalg.norm(np.cross(a, w))
        R = Rotation.from_rotvec(angle * w).as_matrix()
        transport(a, R @ a, Q)
        assert_allclose(Q, normal_basis(R @ a) @ R @ normal_basis(a).T, atol=1e-12)
