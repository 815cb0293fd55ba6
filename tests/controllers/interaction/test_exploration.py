"""Exploration: one step of it, and when it begins."""

import numpy as np
import pytest
from known_arm import Q, arm_model, desired
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.impedance import (
    NO_MOTION,
    DesiredMotion,
)
from crossmodal.controllers.interaction.exploration import (
    ExplorationConfig,
    ExplorationController,
    explore_step,
)
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.maths import se3

BACK = np.array([0.0, 0.0, -1.0])


def test_a_hand_that_lags_pulls_the_goal_ahead_in_the_wanted_direction() -> None:
    wanted = np.array([0, 0, 0, 0, 0, -0.02])
    X = explore_step(np.eye(4), 0.5 * wanted, wanted, 0.1)
    assert_allclose(X[:3, 3], [0, 0, -0.001])
    assert_allclose(explore_step(np.eye(4), wanted, wanted, 0.1), np.eye(4))


def explore_once(phase: Phase, lead: float = np.inf) -> tuple[np.ndarray, DesiredMotion]:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    controller = ExplorationController(ExplorationConfig(lead=lead), arm_model())
    context = controller.CreateDefaultContext()
    controller.GetInputPort("pull_direction").FixValue(context, BACK)
    controller.GetInputPort("joint_state_measured").FixValue(
        context, np.concatenate([Q, np.zeros(7)])
    )
    goal = state.X_WE @ se3.exp(np.full(6, 0.05))
    commanded = AbstractValue.Make(desired(goal))
    controller.GetInputPort("motion_commanded").FixValue(context, commanded)
    controller.GetInputPort("phase").FixValue(context, [float(phase)])
    simulator = Simulator(controller, context)
    simulator.AdvanceTo(0.005)
    return state.X_WE, controller.GetOutputPort("motion_desired").Eval(context)


def test_before_exploration_nothing_is_asked_of_the_arm() -> None:
    assert explore_once(Phase.CLOSE)[1] is NO_MOTION


def test_exploration_advances_the_goal_along_the_pull_and_lets_the_rest_follow_the_hand() -> None:
    X_WE, motion = explore_once(Phase.EXPLORE)
    assert motion.exists
    error = se3.log(se3.inverse(X_WE) @ motion.X_WE)
    step = ExplorationConfig().gain * ExplorationConfig().speed
    assert_allclose(error[:5], 0.0, atol=1e-9)
    assert_allclose(error[5], 0.05 - step, atol=1e-6)
    assert_allclose(motion.V_WE_E, [0, 0, 0, 0, 0, -0.02])


def test_the_goal_is_no_farther_ahead_than_it_may_be() -> None:
    X_WE, motion = explore_once(Phase.EXPLORE, lead=0.04)
    error = se3.log(se3.inverse(X_WE) @ motion.X_WE)
    step = ExplorationConfig().gain * ExplorationConfig().speed
    assert_allclose(error[5], 0.04 - step, atol=1e-6)


@pytest.mark.parametrize(("field", "value"), [("speed", -1.0), ("gain", np.nan), ("period", 0.0)])
def test_impossible_values_are_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"ExplorationController: {field} = "):
        ExplorationController(ExplorationConfig(**{field: value}), arm_model())
