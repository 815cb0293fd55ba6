"""The switch of commands: who is away from home commands."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from crossmodal.controllers.arm.command_switch import CommandSwitch

HOME, AWAY, ELSEWHERE = np.array([0.1, -0.2]), np.array([0.5, 0.0]), np.array([0.1, 0.3])


@pytest.mark.parametrize(
    ("first", "second", "commanded"),
    [(HOME, HOME, HOME), (AWAY, HOME, AWAY), (HOME, AWAY, AWAY), (AWAY, ELSEWHERE, AWAY)],
)
def test_who_is_away_from_home_commands(
    first: np.ndarray, second: np.ndarray, commanded: np.ndarray
) -> None:
    switch = CommandSwitch(["move", "touch"], HOME)
    context = switch.CreateDefaultContext()
    switch.GetInputPort("move_joint_position_commanded").FixValue(context, first)
    switch.GetInputPort("touch_joint_position_commanded").FixValue(context, second)
    assert_array_equal(switch.GetOutputPort("joint_position_commanded").Eval(context), commanded)
