"""Arrays are assigned as NumPy assigns them."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from crossmodal.maths.in_place import assign


@pytest.mark.parametrize("shape", [(5,), (3, 4)])
def test_an_array_is_overwritten_and_what_is_around_it_is_not(shape: tuple[int, ...]) -> None:
    values = np.arange(float(np.prod(shape))).reshape(shape)
    around = np.full([n + 2 for n in shape], -1.0)
    expected = around.copy()
    inside = tuple(slice(1, -1) for _ in shape)
    assign(around[inside], values)
    expected[inside] = values
    assert_array_equal(around, expected)
