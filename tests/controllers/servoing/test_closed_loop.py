"""A fingertip turns a flap by its edge: touch, vision and sequence in a closed loop.

Taxels with noise of 0.01 N and a threshold, 20 ms of latency; hydroelastic contact.
"""

import numpy as np
import pytest
from trial_scene import Outcome, Trial, simulate

from crossmodal.controllers.servoing.flip_config import FlipSequenceConfig
from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.diagrams.flap.flip_control import FlipControlConfig

SETTLED = 1.0  # After the flip has begun, [s].


def until(angle: float) -> FlipControlConfig:
    return FlipControlConfig(sequence=FlipSequenceConfig(angle=angle))


def settled(outcome: Outcome) -> np.ndarray:
    """Which samples are of the flip once it is under way."""
    flip = outcome.phases == FlipPhase.FLIP
    return flip & (outcome.times > outcome.times[flip][0] + SETTLED)


def check_contact(outcome: Outcome, when: np.ndarray) -> None:
    force, place = outcome.of("force")[when], 1e3 * outcome.of("p_SC")[when]
    assert np.sqrt(np.mean((force - 0.5) ** 2)) < 0.05
    assert np.all(np.std(place[:, [0, 2]], axis=0) < 0.3)


def misalignment(outcome: Outcome) -> np.ndarray:
    """n . n_f by the pad's normal (K,), as an angle, [rad]."""
    n_f = np.column_stack([np.cos(outcome.theta), 0.0 * outcome.theta, np.sin(outcome.theta)])
    return np.arcsin(np.sum(outcome.X_WS[:, :3, 1] * n_f, axis=1))


def test_touch_and_the_arc_turn_the_flap_blindly() -> None:
    outcome = simulate(Trial(control=until(0.35)), 20.0)
    assert outcome.phases[-1] == FlipPhase.RETREAT
    assert outcome.theta[-1] == pytest.approx(0.35, abs=0.05)
    check_contact(outcome, settled(outcome))


def test_vision_rolls_a_misplaced_finger_into_the_flaps_direction() -> None:
    trial = Trial(
        control=until(0.35), vision=True, hinge_known=True, roll=np.deg2rad(8.0), misplaced=1e-3
    )
    outcome = simulate(trial, 20.0)
    assert outcome.phases[-1] == FlipPhase.RETREAT
    assert outcome.theta[-1] == pytest.approx(0.35, abs=0.03)
    assert abs(misalignment(outcome)[-1]) < np.deg2rad(1.0)
    assert np.all(outcome.of("force")[settled(outcome)] > 0.0)


def test_a_flap_that_is_jerked_away_by_3_cm_is_caught_again() -> None:
    trial = Trial(control=until(0.6), vision=True, hinge_known=True, swing=(2.0, 2.25, 1.5))
    outcome = simulate(trial, 20.0)
    lost = outcome.times[(outcome.of("force") == 0.0) & (outcome.times > 2.0)]
    jerked = np.interp(2.5, outcome.times, outcome.theta)
    assert trial.length * jerked > 0.03
    assert 1.0 < lost[-1] - lost[0] < 5.0
    assert outcome.phases[-1] == FlipPhase.RETREAT
    assert outcome.of("force")[-1] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(("rate", "end"), [(1.5, 22.0), (-1.5, 28.0)])
def test_a_flap_that_nobody_sees_go_is_sought_on_its_arc(rate: float, end: float) -> None:
    trial = Trial(
        control=until(0.6),
        vision=True,
        hinge_known=True,
        swing=(4.0, 4.2, rate),
        blind_from=3.9,
    )
    outcome = simulate(trial, end)
    before, after = np.interp([3.9, 4.5], outcome.times, outcome.theta)
    assert trial.length * abs(after - before) > 0.02
    contact = outcome.of("force") > 0.2
    lost = ~contact & (outcome.times > 4.0)
    back = np.flatnonzero(contact & (outcome.times > outcome.times[lost][0]))[0]
    assert 4.0 < outcome.times[back] - 4.0 < 25.0
    assert contact[back : back + 100].mean() > 0.95
