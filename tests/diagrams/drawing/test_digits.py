import math

import pytest

from crossmodal.diagrams.drawing.digits import fixed, written, written_range


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-0.03123, "-0.031 mm"),
        (0.0996, "0.10 mm"),
        (-5.14, "-5.1 mm"),
        (123.4, "123 mm"),
        (2.0, "2 mm"),
        (0.0, "0 mm"),
        (-1e-9, "0 mm"),
        (None, "-"),
        (math.nan, "-"),
        (math.inf, "none mm"),
    ],
)
def test_two_digits_of_a_value_are_shown(value: float | None, text: str) -> None:
    assert written(value, "mm") == text


def test_a_value_has_as_many_places_as_two_digits_of_its_deviation() -> None:
    assert written(24.4631, "cm", spread=0.0263) == "24.463 ± 0.026 cm"
    assert written(-0.0001, "cm", spread=0.263) == "0.00 ± 0.26 cm"
    assert written(31.4, "deg", spread=math.inf) == "31 ± none deg"


def test_a_value_has_as_many_places_as_what_it_stands_beside() -> None:
    assert written(20.0, "cm", beside=-0.0312) == "20.000 cm"
    assert written(20.34, "cm", beside=0.0) == "20 cm"


@pytest.mark.parametrize("value", [-0.0, -0.4, -0.04, -1e-12])
def test_no_zero_has_a_sign_before_it(value: float) -> None:
    assert fixed(value, 0) == "0"
    assert fixed(value, 0, signed=True) == "+0"
    assert written(value, beside=12.0) == "0"


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((0.0123, 0.0412, 0.3123), "0.041 (0.012 to 0.312) mm"),
        ((0.038, 0.1, 5.063), "0.10 (0.04 to 5.06) mm"),
        ((1.2, 2.8, 11.3), "2.8 (1.2 to 11.3) mm"),
        ((37.0, 51.2, math.inf), "51 (37 to none) mm"),
        ((24.0, 24.1, 24.2), "24.10 (24.00 to 24.20) mm"),
        ((0.0, 0.0, 0.0), "0 (0 to 0) mm"),
    ],
)
def test_a_range_shows_two_digits_of_its_median_and_of_its_width(
    values: tuple[float, float, float], text: str
) -> None:
    assert written_range(*values, "mm") == text
