"""What is believed of the hand is possible, and its axis is a direction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.proprioception.hand_config import HandConfig, check_hand


def test_the_grasping_axis_is_a_unit_vector_along_the_bar() -> None:
    axis, point = HandConfig(axis_H=np.array([0.0, 3.0, 4.0])).grasping_axis
    assert_allclose(axis, [0.0, 0.6, 0.8])
    assert_allclose(point, [0.0, 0.0, -0.02])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mass", -1.0),
        ("correlation_time", 0.0),
        ("p_S_com", np.zeros(2)),
        ("axis_H", np.zeros(3)),
        ("slip_rotation", -1.0),
    ],
)
def test_impossible_values_are_refused(field: str, value: object) -> None:
    config = HandConfig()
    setattr(config, field, value)
    with pytest.raises(ValueError, match=f"GraspModel: {field}"):
        check_hand(config, "GraspModel")
