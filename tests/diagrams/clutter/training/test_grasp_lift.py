import numpy as np

from crossmodal.diagrams.clutter.training.grasp_lift import simulate_lift


def test_a_box_that_is_grasped_at_its_middle_is_lifted() -> None:
    lift = simulate_lift("black_box", np.eye(4), np.array([0.0, 0.0, np.pi / 2, 0.126, 0.015]))
    assert lift.held
    assert np.rad2deg(lift.turned) < 3.0


def test_a_screwdriver_that_is_grasped_at_its_shaft_turns() -> None:
    lift = simulate_lift("screwdriver", np.eye(4), np.array([0.05, 0.0, np.pi / 2, 0.02, 0.005]))
    assert not lift.held
