"""The hand's pneumatics against the gas law and virtual work."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from crossmodal.plants.hands.pneumatic_hand import (
    ATMOSPHERE,
    PneumaticHand,
    PneumaticHandConfig,
    chamber_rates,
)


def make_hand(theta: np.ndarray, pressure: float, sealed: float) -> tuple[PneumaticHand, object]:
    hand = PneumaticHand(PneumaticHandConfig())
    context = hand.CreateDefaultContext()
    hand.GetInputPort("hand_state").FixValue(context, np.concatenate([theta, np.zeros(15)]))
    hand.GetInputPort("pressure_commanded").FixValue(context, np.full(4, pressure))
    hand.GetInputPort("sealed").FixValue(context, [sealed])
    return hand, context


def test_open_valves_fill_the_chambers_to_the_commanded_pressure_whatever_the_posture() -> None:
    theta = np.linspace(0.0, 1.0, 15)
    hand, context = make_hand(theta, 5e4, sealed=0.0)
    simulator = Simulator(hand, context)
    simulator.AdvanceTo(3.0)
    pressure = hand.GetOutputPort("cheat_pressure").Eval(simulator.get_context())
    assert_allclose(pressure, 5e4, rtol=1e-6)


def test_sealed_chambers_obey_the_gas_law() -> None:
    config = PneumaticHandConfig()
    hand, context = make_hand(np.zeros(15), 0.0, sealed=1.0)
    theta = np.full(15, 0.5)
    hand.GetInputPort("hand_state").FixValue(context, np.concatenate([theta, np.zeros(15)]))
    simulator = Simulator(hand, context)
    simulator.AdvanceTo(0.5)
    pressure = hand.GetOutputPort("cheat_pressure").Eval(simulator.get_context())
    straight = np.array([1, 1, 2, 0]) * config.finger_volume
    straight[3] = config.thumb_volume
    bent = straight + chamber_rates(config) @ theta
    assert_allclose(pressure, ATMOSPHERE * (straight / bent - 1.0))
    assert np.all(pressure < 0)


@pytest.mark.parametrize("sealed", [0.0, 1.0])
def test_chambers_that_leak_lose_their_air_whether_sealed_or_not(sealed: float) -> None:
    hand, context = make_hand(np.full(15, 0.5), 5e4, sealed=0.0)
    simulator = Simulator(hand, context)
    simulator.AdvanceTo(3.0)
    hand.GetInputPort("sealed").FixValue(simulator.get_mutable_context(), [sealed])
    hand.GetInputPort("leaking").FixValue(simulator.get_mutable_context(), [1.0])
    simulator.AdvanceTo(3.0 + 2.0 * PneumaticHandConfig().fill_time)
    pressure = hand.GetOutputPort("cheat_pressure").Eval(simulator.get_context())
    assert_allclose(pressure, 5e4 * np.exp(-2.0), rtol=0.05)


def test_torque_is_pressure_times_volume_rate() -> None:
    hand, context = make_hand(np.zeros(15), 6e4, sealed=0.0)
    simulator = Simulator(hand, context)
    simulator.AdvanceTo(3.0)
    torques = hand.GetOutputPort("joint_torques").Eval(simulator.get_context())
    assert_allclose(torques, 6e4 * chamber_rates(PneumaticHandConfig()).sum(axis=0), rtol=1e-6)


def test_an_impossible_volume_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="finger_volume"):
        PneumaticHand(PneumaticHandConfig(finger_volume=0.0))
