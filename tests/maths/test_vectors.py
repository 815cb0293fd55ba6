"""Cross products and tangent bases, against NumPy and their definition."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.vectors import cross, tangent_basis


@pytest.mark.parametrize("seed", range(5))
def test_the_cross_product_is_that_of_numpy(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    assert_allclose(cross(a, b), np.cross(a, b))


@pytest.mark.parametrize("seed", range(5))
def test_an_axis_and_its_tangent_basis_are_a_right_handed_frame(seed: int) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    R = np.column_stack([tangent_basis(axis), axis])
    assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert_allclose(np.linalg.det(R), 1.0)


@pytest.mark.parametrize("axis", np.eye(3))
def test_a_coordinate_axis_has_one_too(axis: np.ndarray) -> None:
    U = tangent_basis(axis)
    assert_allclose(U.T @ U, np.eye(2), atol=1e-14)
    assert_allclose(axis @ U, 0.0, atol=1e-14)
