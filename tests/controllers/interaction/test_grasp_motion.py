"""How the hand moves and gives way."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.controllers.interaction.grasp_sequence import exploration_gains
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig

BACK = np.array([0.0, 0.0, -1.0])


def test_exploration_is_compliant_but_in_the_pulling_direction() -> None:
    compliant = exploration_gains(GraspSequenceConfig(), 3.0 * BACK)
    assert_allclose(np.diag(compliant.stiffness), [0.1] * 5 + [400.0])
    assert_allclose(np.diag(compliant.damping), [1.0] * 5 + [200.0])
    assert_allclose(compliant.mass, np.eye(6))
