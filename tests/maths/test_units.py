"""Units as text: what measures the same is converted, what does not is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.units import in_unit


@pytest.mark.parametrize(
    ("value", "unit", "wanted", "expected"),
    [
        (5, "cm", "m", 0.05),
        (20, "mm", "m", 0.02),
        (0.2, "m", "mm", 200.0),
        (3, "s", "s", 3.0),
        (2, "min", "s", 120.0),
        (180, "deg", "rad", np.pi),
        (58, "deg", "deg", 58.0),
        (90, "deg", "m or rad", 0.5 * np.pi),
        (7, "cm", "m or rad", 0.07),
        (60, "kPa", "Pa", 60000.0),
        (1, "bar", "Pa", 1e5),
        (3, "cm/s", "m/s", 0.03),
        (5, "N/mm", "N/m", 5000.0),
        (200, "N cm", "N·m", 2.0),
        (2, "N*m", "N m", 2.0),
        (50, "Hz", "1/s", 50.0),
        (1, "1/ms", "Hz", 1000.0),
        (4, "cm/s^0.5", "m/s^0.5", 0.04),
        (640, "px", "px", 640.0),
        (1, "kg m/s^2", "N", 1.0),
    ],
)
def test_a_value_is_the_same_in_another_unit(
    value: float, unit: str, wanted: str, expected: float
) -> None:
    assert_allclose(in_unit(value, unit, wanted), expected, rtol=1e-14)


def test_decimal_values_become_the_numbers_that_are_meant() -> None:
    for centimetres in range(1000):
        assert in_unit(centimetres, "cm", "m") == float(f"{centimetres}e-2")


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [
        ("deg", "m"),
        ("cm", "s"),
        ("N", "N m"),
        ("N m", "N m/rad"),
        ("cm", ""),
        ("parsec", "m"),
        ("px", "episode"),
        ("m/s", "m or rad"),
        ("?", "m"),
        ("m^", "m"),
    ],
)
def test_what_measures_something_else_is_refused(unit: str, wanted: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        in_unit(1.0, unit, wanted)
