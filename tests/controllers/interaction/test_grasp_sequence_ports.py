"""The grasp sequence through its ports."""

import numpy as np
import pytest
from known_arm import STILL, Q, arm_model
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.interaction.grasp_sequence import GraspSequence
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.maths import se3


def test_the_sequence_goes_through_its_phases_and_stops_after_its_travel() -> None:
    config = GraspSequenceConfig(approach_time=0.1, close_time=0.1, travel=0.05)
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    sequence = GraspSequence(config, arm_model(), state.X_WE, state.X_WE)
    simulator = Simulator(sequence)
    context = simulator.get_mutable_context()
    port = sequence.GetInputPort("joint_state_measured")
    port.FixValue(context, np.concatenate([Q, np.zeros(7)]))

    def phase_at(time: float) -> int:
        simulator.AdvanceTo(time)
        return int(sequence.GetOutputPort("phase").Eval(context)[0])

    assert phase_at(0.05) == Phase.APPROACH
    assert sequence.GetOutputPort("interaction_active").Eval(context)[0] == 0
    assert phase_at(0.15) == Phase.CLOSE
    assert np.all(sequence.GetOutputPort("pressure_commanded").Eval(context) > 0)
    assert phase_at(0.25) == Phase.EXPLORE
    assert sequence.GetOutputPort("interaction_active").Eval(context)[0] == 1
    moved = Q.copy()
    moved[3] += 0.3
    port.FixValue(context, np.concatenate([moved, np.zeros(7)]))
    assert phase_at(0.3) == Phase.STOP


def test_a_hand_that_comes_away_empty_says_that_it_holds_nothing_any_more() -> None:
    config = GraspSequenceConfig(approach_time=0.1, close_time=0.1)
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    sequence = GraspSequence(config, arm_model(), state.X_WE, state.X_WE)
    simulator = Simulator(sequence)
    context = simulator.get_mutable_context()
    sequence.GetInputPort("joint_state_measured").FixValue(context, np.append(Q, np.zeros(7)))
    held = np.array(config.closing_pressure)

    def after(time: float, pressure: np.ndarray) -> dict[str, float]:
        sequence.GetInputPort("pressure_measured").FixValue(context, pressure)
        simulator.AdvanceTo(time)
        names = ("phase", "interaction_active", "grasp_lost")
        return {name: sequence.GetOutputPort(name).Eval(context)[0] for name in names}

    holding = {"phase": Phase.EXPLORE, "interaction_active": 1, "grasp_lost": 0}
    assert after(0.25, held) == holding
    assert after(0.35, held * [0.7, 0.7, 0.9, 0.7]) == holding
    assert after(0.45, 0.7 * held) == {
        "phase": Phase.STOP,
        "interaction_active": 0,
        "grasp_lost": 1,
    }


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("approach_time", 0.0),
        ("travel", np.nan),
        ("empty_pressure", 1.0),
        ("retries", -1),
        ("closing_pressure", []),
        ("pull_stiffness", np.inf),
    ],
)
def test_impossible_values_are_refused_by_name(field: str, value: object) -> None:
    config = GraspSequenceConfig(**{field: value})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"GraspSequence: {field} = "):
        GraspSequence(config, arm_model(), np.eye(4), np.eye(4))


def test_the_arm_tares_while_it_stands_still_before_the_object() -> None:
    config = GraspSequenceConfig(approach_time=0.1, close_time=0.1, standing=0.5)
    X_WE_before = se3.exp(np.array([0.0, 0.1, 0.0, 0.0, 0.0, -0.1]))
    sequence = GraspSequence(config, arm_model(), np.eye(4), X_WE_before)
    simulator = Simulator(sequence)
    sequence.GetInputPort("joint_state_measured").FixValue(simulator.get_mutable_context(), STILL)
    flags, poses = [], []
    for time in (0.03, 0.08, 0.15, 0.25):
        simulator.AdvanceTo(time)
        flags.append(sequence.GetOutputPort("in_free_space").Eval(simulator.get_context())[0])
        poses.append(sequence.GetOutputPort("motion_desired").Eval(simulator.get_context()).X_WE)
    assert flags == [1.0, 0.0, 0.0, 0.0]
    assert_allclose(poses[0], X_WE_before, atol=1e-12)
    assert not np.allclose(poses[1], X_WE_before)
    assert_allclose(poses[2], np.eye(4), atol=1e-12)
