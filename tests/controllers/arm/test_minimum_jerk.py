"""The blend from rest to rest."""

from numpy.testing import assert_allclose

from crossmodal.controllers.arm.minimum_jerk import PEAK_RATE, minimum_jerk


def test_the_blend_has_the_derivatives_it_claims() -> None:
    h = 1e-5
    for s in (0.1, 0.5, 0.83):
        position, rate, acceleration = minimum_jerk(s)
        low, high = minimum_jerk(s - h), minimum_jerk(s + h)
        assert_allclose(rate, (high[0] - low[0]) / (2 * h), rtol=1e-6)
        assert_allclose(acceleration, (high[1] - low[1]) / (2 * h), rtol=1e-6, atol=1e-6)
        assert 0 < position < 1


def test_the_blend_is_fastest_in_the_middle() -> None:
    assert minimum_jerk(0.5)[1] == PEAK_RATE
