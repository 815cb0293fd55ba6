import numpy as np
import pytest

from crossmodal.systems.tactile.skin import indentation

SPHERE = np.array([0.01, 0.01, 0.01])


def test_the_force_grows_with_the_depth_as_hertz_says() -> None:
    depth = indentation(0.5, 3e5, SPHERE)
    force = 4.0 / 3.0 * 3e5 / (1.0 - 0.25) * np.sqrt(0.01) * depth**1.5
    assert force == pytest.approx(0.5)
    assert indentation(4.0, 3e5, SPHERE) == pytest.approx(4.0 * depth)


def test_a_long_fingertip_is_pressed_in_less() -> None:
    assert indentation(0.5, 3e5, np.array([0.01, 0.01, 0.02])) < indentation(0.5, 3e5, SPHERE)
    assert indentation(0.0, 3e5, SPHERE) == 0.0
