"""Taxels that do not work are left out and told."""

import numpy as np
import pytest

from crossmodal.systems.port_values import StreamHealth
from crossmodal.systems.tactile.contact_features import ContactFeaturesConfig
from crossmodal.systems.tactile.taxel_layout import fingertip_layout
from crossmodal.systems.tactile.taxel_monitor import (
    TaxelMonitor,
    TaxelState,
    next_taxel_state,
    unread_taxels,
)

LAYOUT, CONFIG = fingertip_layout(), ContactFeaturesConfig()
PRESSED = np.where(np.isin(np.arange(12), [0, 3, 8, 11]), 0.125, 0.0)


def feel(seconds: float, broken: dict[int, float], start: TaxelState | None = None) -> TaxelState:
    """The state after so long under a contact in the middle, some taxels reading a constant."""
    rng = np.random.default_rng(3)
    state = start or unread_taxels(LAYOUT)
    for k in range(round(seconds / 0.01)):
        forces = PRESSED + rng.normal(0.0, CONFIG.noise.taxel, 12)
        for index, value in broken.items():
            forces[index] = value
        state = next_taxel_state(state, 0.01 * k, forces, LAYOUT, CONFIG)
    return state


def test_taxels_that_work_are_all_used() -> None:
    state = feel(2.0, {})
    assert state.usable.all()
    assert state.health.fault == ""


def test_a_taxel_that_reads_the_same_for_long_is_left_out() -> None:
    state = feel(0.5, {5: 0.3})
    assert np.flatnonzero(~state.usable).tolist() == [5]
    assert state.health.fault == "dead or stuck taxels: 5"
    assert abs(state.contact.p_SC[0]) < 1e-3


def test_a_silent_taxel_under_the_contact_is_left_out() -> None:
    assert np.flatnonzero(~feel(1.5, {11: 0.0}).usable).tolist() in ([11], [])
    state = unread_taxels(LAYOUT)
    over = np.array([0.125] * 12) * np.isin(np.arange(12), [0, 3, 8, 11, 6, 7])
    rng = np.random.default_rng(4)
    for k in range(100):
        forces = over + rng.normal(0.0, CONFIG.noise.taxel, 12)
        forces[11] = 0.0
        state = next_taxel_state(state, 0.01 * k, forces, LAYOUT, CONFIG)
    assert not state.usable[11]


def test_a_taxel_that_falls_silent_alone_is_dead_and_all_together_have_lost_the_contact() -> None:
    state = feel(0.5, {})
    one = np.where(np.arange(12) == 11, 0.0, state.forces)
    after = next_taxel_state(state, 0.5, one, LAYOUT, CONFIG)
    assert np.flatnonzero(~after.usable).tolist() == [11]
    still = next_taxel_state(after, 0.51, one + 0.001 * PRESSED, LAYOUT, CONFIG)
    assert np.flatnonzero(~still.usable).tolist() == [11]
    assert next_taxel_state(still, 0.52, PRESSED, LAYOUT, CONFIG).usable.all()
    gone = next_taxel_state(state, 0.5, np.zeros(12), LAYOUT, CONFIG)
    assert gone.usable.all()
    fading = np.where(np.arange(12) == 11, 0.0, 0.5 * state.forces)
    assert next_taxel_state(state, 0.5, fading, LAYOUT, CONFIG).usable.all()


def test_a_taxel_that_comes_back_is_used_again() -> None:
    assert feel(0.5, {}, start=feel(0.5, {5: 0.3})).usable.all()


def test_one_dead_taxel_leaves_the_skin_its_feeling() -> None:
    assert feel(1.0, {11: 0.0, 5: 0.3}).health.age == 0.0


def test_a_skin_whose_readings_stand_still_cannot_tell_that_a_contact_ended() -> None:
    """The contact is gone 0.1 s after its taxels froze, and nothing says whether that is true."""
    state = feel(0.5, {})
    frozen = state.forces.copy()
    for k in range(1, 101):
        state = next_taxel_state(state, 0.49 + 0.01 * k, frozen, LAYOUT, CONFIG)
    assert not state.contact.touching
    assert state.health.age == pytest.approx(1.0 - CONFIG.stuck_after, abs=0.03)
    assert state.health.fault.startswith("dead or stuck taxels: 0, 3")
    alive = next_taxel_state(state, 1.5, PRESSED + 0.001, LAYOUT, CONFIG)
    assert alive.contact.touching
    assert alive.health.age == 0.0


def test_a_contact_that_ends_is_believed() -> None:
    state = feel(0.5, {})
    for k in range(50):
        state = next_taxel_state(state, 0.5 + 0.01 * k, np.zeros(12), LAYOUT, CONFIG)
    assert not state.contact.touching
    assert state.health == StreamHealth()


def test_a_reading_that_is_no_number_is_left_out_at_once() -> None:
    state = feel(0.05, {0: np.nan})
    assert np.flatnonzero(~state.usable).tolist() == [0]
    assert state.contact.touching


def test_the_same_sample_twice_changes_nothing() -> None:
    state = feel(0.5, {5: 0.3})
    again = next_taxel_state(state, 0.49, state.forces, LAYOUT, CONFIG)
    np.testing.assert_array_equal(again.usable, state.usable)
    np.testing.assert_array_equal(again.same_since, state.same_since)


def test_ports_give_this_instants_contact_and_the_last_ticks_health() -> None:
    system = TaxelMonitor(CONFIG, LAYOUT)
    context = system.CreateDefaultContext()
    port = system.GetInputPort("taxel_measured")
    port.FixValue(context, PRESSED)
    assert system.GetOutputPort("contact_estimated").Eval(context).force == pytest.approx(
        0.5, rel=0.1
    )
    assert not system.GetOutputPort("contact_latest").Eval(context).touching
    system.ExecuteForcedEvents(context)
    assert system.GetOutputPort("contact_latest").Eval(context).touching
    assert system.GetOutputPort("health_latest").Eval(context).fault == ""
    for k in range(1, 40):
        context.SetTime(0.01 * k)
        forces = PRESSED + 1e-4 * k
        forces[4] = 0.2
        port.FixValue(context, forces)
        system.ExecuteForcedEvents(context)
    assert "4" in system.GetOutputPort("health_latest").Eval(context).fault


def test_thresholds_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValueError, match="TaxelMonitor: release_force"):
        TaxelMonitor(ContactFeaturesConfig(release_force=0.2), LAYOUT)
