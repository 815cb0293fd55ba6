"""Cross products against NumPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.vectors import cross


@pytest.mark.parametrize("seed", range(5))
def test_the_cross_product_is_that_of_numpy(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    assert_allclose(cross(a, b), np.cross(a, b))
