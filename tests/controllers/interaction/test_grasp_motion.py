"""How the hand moves and gives way."""

import numpy as np
from numpy.testing import assert_allclose

from controllers.interaction.grasp_motion import exploration_gains, minimum_jerk
from controllers.interaction.grasp_sequence_config import GraspSequenceConfig

BACK = np.array([0.0, 0.0, -1.0])


def test_exploration_is_compliant_but_in_the_pulling_direction() -> None:
    compliant = exploration_gains(GraspSequenceConfig(), 3.0 * BACK)
    assert_allclose(np.diag(compliant.stiffness), [0.1] * 5 + [400.0])
    assert_allclose(np.diag(compliant.damping), [1.0] * 5 + [200.0])
    assert_allclose(compliant.mass, np.eye(6))


def test_the_blend_has_the_derivatives_it_claims() -> None:
    h = 1e-5
    for s in (0.1, 0.5, 0.83):
        position, rate, acceleration = minimum_jerk(s)
        low, high = minimum_jerk(s - h), minimum_jerk(s + h)
        assert_allclose(rate, (high[0] - low[0]) / (2 * h), rtol=1e-6)
        assert_allclose(acceleration, (high[1] - low[1]) / (2 * h), rtol=1e-6, atol=1e-6)
        assert 0 < position < 1
