"""What load and pressures say of an empty or slipping hand, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

from crossmodal.systems.port_values import (
    NO_SLIP,
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    HandLoad,
    SlipBelief,
)
from crossmodal.systems.proprioception.slip_detection import (
    SlipDetection,
    SlipDetectionConfig,
    force_odds,
    pressure_odds,
)

CONFIG = SlipDetectionConfig()
OPEN = np.array([100.0, -50.0, 0.0, 200.0])
CLOSED = np.array([6.0e4, 6.0e4, 6.0e4, 8.0e4])
BIAS = np.array([0.01, -0.02, 0.0, 0.3, -0.2, 0.4])


def load(pressures: np.ndarray, force: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> HandLoad:
    return HandLoad(F_S=BIAS + np.array([0.0, 0.0, 0.0, *force]), pressures=pressures)


class Hand:
    """The system, ticked by hand; the hand goes along x."""

    def __init__(self) -> None:
        self.system = SlipDetection(CONFIG)
        self.context = self.system.CreateDefaultContext()
        self.way = 0.0

    def tick(self, hand_load: HandLoad, active: bool, way: float = 0.0) -> SlipBelief:
        self.way += way
        X = np.eye(4)
        X[0, 3] = 0.5 + self.way
        for name, value in (
            ("hand_load_estimated", hand_load),
            ("end_effector_estimated", replace(UNKNOWN_END_EFFECTOR, X=X)),
        ):
            self.system.GetInputPort(name).FixValue(self.context, AbstractValue.Make(value))
        self.system.GetInputPort("interaction_active").FixValue(self.context, float(active))
        belief: SlipBelief = self.system.GetOutputPort("slip_estimated").Eval(self.context)
        self.system.ExecuteForcedEvents(self.context)
        assert self.system.GetOutputPort("slip_latest").Eval(self.context) == belief
        return belief

    def close(self, force: tuple[float, float, float] = (0.0, 0.0, 3.0)) -> None:
        for _ in range(30):
            assert self.tick(load(OPEN), active=False) == NO_SLIP
        self.tick(load(CLOSED, force), active=True)


def test_the_odds_of_the_pressures_are_those_of_a_gaussian_and_an_even_density() -> None:
    reference, now = load(CLOSED), load(CLOSED * [1.05, 1.0, 0.98, 1.0], force=(0.0, 0.0, 10.0))
    variance = CONFIG.pressure_deviation**2 + (10.0 * CONFIG.pressure_by_force) ** 2
    stays = -0.5 * (0.05**2 + 0.02**2) / variance - 2.0 * np.log(2.0 * np.pi * variance)
    moved = -4.0 * np.log(CONFIG.pressure_range)
    held = np.log((1.0 - CONFIG.shifting) * np.exp(stays) + CONFIG.shifting * np.exp(moved))
    assert pressure_odds(now, reference, CONFIG) == pytest.approx(moved - held)


def test_a_hand_without_load_holds_nothing_or_something_without_friction() -> None:
    ratio = (1.0 + (CONFIG.held_force / CONFIG.empty_force) ** 2) ** 1.5
    share = CONFIG.frictionless
    expected = -np.log(share + (1.0 - share) / ratio)
    assert force_odds(np.zeros(3), CONFIG) == pytest.approx(expected)
    assert force_odds(np.array([0.0, 0.0, 2.0]), CONFIG) < 0.0


@pytest.mark.parametrize("force", [1.5, 4.0, 12.0])
def test_a_hand_that_pulls_a_bar_is_not_doubted(force: float) -> None:
    hand = Hand()
    hand.close()
    for k in range(150):
        creep = 1.0 - 0.02 * k / 150
        assert hand.tick(load(CLOSED * creep, (0.0, 0.0, force)), True, way=0.0013) == NO_SLIP


def test_a_finger_that_curls_on_has_lost_the_bar_or_shifted_it() -> None:
    hand = Hand()
    hand.close()
    belief = hand.tick(load(CLOSED * [1.0, 1.0, 1.0, 0.65], (0.0, 0.0, 5.0)), True)
    assert belief.log_odds == pytest.approx(-np.log(CONFIG.shifting), abs=0.01)
    assert belief.shift == pytest.approx(0.32 * CONFIG.shift_by_pressure, rel=0.03)


def test_a_hand_that_leaks_has_lost_the_bar() -> None:
    hand = Hand()
    hand.close()
    share = 1.0 - CONFIG.fist
    shifted, flat = (hand.tick(load(k * share * CLOSED), True).log_odds for k in (1.01, 0.99))
    assert shifted < 4.0
    assert flat == CONFIG.limit


def test_a_hand_that_has_curled_past_a_lid_and_pushes_it_may_hold_it() -> None:
    hand = Hand()
    hand.close()
    for _ in range(60):
        belief = hand.tick(load(0.6 * CLOSED, (2.0, 0.0, -2.0)), True, way=0.002)
    assert belief.log_odds == pytest.approx(-np.log(CONFIG.shifting), abs=0.01)


def test_pressures_that_the_load_explains_are_no_slip() -> None:
    hand = Hand()
    hand.close()
    assert hand.tick(load(1.05 * CLOSED, (0.0, 0.0, 30.0)), True) == NO_SLIP
    assert hand.tick(load(1.05 * CLOSED, (0.0, 0.0, 5.0)), True).shift > 0.002


def test_nobody_knows_where_the_bar_is_under_a_load_that_was_never_tried() -> None:
    hand = Hand()
    hand.close()
    belief = hand.tick(load(1.1 * CLOSED, (0.0, 0.0, 3.0 + CONFIG.known_force + 70.0)), True)
    assert belief == SlipBelief(log_odds=0.0, shift=pytest.approx(70.0 * CONFIG.shift_by_force))


def test_a_shift_is_not_forgotten() -> None:
    hand = Hand()
    hand.close()
    shifted = hand.tick(load(1.15 * CLOSED, (0.0, 0.0, 5.0)), True).shift
    assert hand.tick(load(CLOSED, (0.0, 0.0, 5.0)), True) == SlipBelief(log_odds=0.0, shift=shifted)


def test_a_hand_that_closed_on_nothing_is_found_out_once_it_moves() -> None:
    hand = Hand()
    hand.close(force=(0.0, 0.0, 0.0))
    beliefs = [hand.tick(load(CLOSED, (0.1, 0.0, -0.1)), True, way=0.0013) for _ in range(60)]
    assert beliefs[10].log_odds == 0.0
    assert beliefs[-1].log_odds > 3.5


def test_nothing_measured_says_nothing_new() -> None:
    hand = Hand()
    assert hand.tick(UNKNOWN_LOAD, active=False) == NO_SLIP
    hand.close()
    before = hand.tick(load(0.8 * CLOSED), True)
    assert hand.tick(UNKNOWN_LOAD, True) == before


def test_a_hand_that_opens_begins_anew() -> None:
    hand = Hand()
    hand.close()
    assert hand.tick(load(0.5 * CLOSED), True) != NO_SLIP
    hand.close()
    assert hand.tick(load(CLOSED, (0.0, 0.0, 4.0)), True) == NO_SLIP


def test_impossible_values_are_refused() -> None:
    with pytest.raises(ValueError, match="SlipDetection: empty_force"):
        SlipDetection(SlipDetectionConfig(empty_force=0.0))
