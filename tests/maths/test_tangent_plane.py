"""The basis of a tangent plane."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maths.tangent_plane import normal_basis


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [0, -1.0, 0], [1.0, 0, 0], [0.6, 0.0, 0.8]])
def test_the_tangent_basis_is_orthonormal_and_right_handed_with_the_axis(axis: list[float]) -> None:
    B = normal_basis(np.array(axis))
    assert_allclose(np.vstack([B, axis]) @ np.vstack([B, axis]).T, np.eye(3), atol=1e-15)
    assert_allclose(np.cross(axis, B[0]), B[1], atol=1e-15)
