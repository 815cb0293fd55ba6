"""The hinge over simulated seeds, and what is not known of it."""

import numpy as np
import pytest
from flap_episode import DEGREES, LIMITS, Episode, run
from synthetic_flap import PERIOD, Laboratory

from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.systems.flap.hinge.hinge_estimator import (
    HingeEstimatorConfig,
    HingeState,
    update_hinge,
)
from crossmodal.systems.port_values import UNKNOWN_FINGERTIP

SEEDS = range(10)


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    return [run(Laboratory(seed)) for seed in SEEDS]


@pytest.mark.parametrize("name", ["axis", "point", "theta", "L1", "L2"])
def test_errors_are_as_large_as_their_covariances_say(episodes: list[Episode], name: str) -> None:
    for index in (-1, 200):
        values = [episode.nees[name][index] for episode in episodes]
        _, high = chi_square_bounds(DEGREES[name] * len(values), 0.999)
        assert sum(values) < high
    # Nor are the covariances too large by far.
    ends = [episode.nees[name][-1] for episode in episodes]
    assert np.mean(ends) > 0.1 * DEGREES[name]


def test_the_hinge_is_found_to_millimetres_by_its_lever(episodes: list[Episode]) -> None:
    assert np.median([episode.at("axis", np.deg2rad(30.0)) for episode in episodes]) < 0.015
    assert np.median([episode.error["L2"][-1] for episode in episodes]) < 0.002
    assert np.median([episode.error["L1"][-1] for episode in episodes]) < 0.015


def test_a_registered_camera_and_arms_tell_where_the_hinge_is_in_the_holders_hand(
    episodes: list[Episode],
) -> None:
    registered = [run(Laboratory(seed), registered=True) for seed in SEEDS]
    L1 = np.median([episode.error["L1"][-1] for episode in registered])
    assert L1 < 0.003
    assert 0.5 * np.median([episode.error["L1"][-1] for episode in episodes]) > L1
    for name in ("axis", "L1", "L2"):
        values = [episode.nees[name][-1] for episode in registered]
        assert sum(values) < chi_square_bounds(DEGREES[name] * len(values), 0.999)[1]


def test_nothing_is_believed_before_the_flap_has_turned() -> None:
    lab, state, config = Laboratory(0), HingeState(), HingeEstimatorConfig()
    for i in range(60):
        theta = lab.theta(i * PERIOD)
        contact, plane = lab.contact(theta, 0.0), lab.plane(theta)
        state = update_hinge(state, contact, plane, lab.displacements(), config, LIMITS)
        if theta < 0.1:
            assert not state.belief.known
            assert np.isnan(state.belief.k_W).all()


def test_without_a_contact_the_hinge_stays_as_it_is() -> None:
    lab, config = Laboratory(0), HingeEstimatorConfig()
    state, known = HingeState(), lab.displacements()
    for i in range(150):
        theta = lab.theta(i * PERIOD)
        contact, plane = lab.contact(theta, 0.08), lab.plane(theta)
        state = update_hinge(state, contact, plane, known, config, LIMITS)
    assert state.belief.known
    after = update_hinge(state, UNKNOWN_FINGERTIP, lab.plane(0.3), known, config, LIMITS)
    assert after is state


def test_the_window_of_keyframes_is_bounded_and_keeps_the_first() -> None:
    lab, config = Laboratory(0), HingeEstimatorConfig(memory=10)
    state, known = HingeState(), lab.displacements()
    for i in range(0, 400, 3):
        theta = lab.theta(i * PERIOD)
        contact, plane = lab.contact(theta, 0.08), lab.plane(theta)
        state = update_hinge(state, contact, plane, known, config, LIMITS)
    assert len(state.keyframes) == 10
    assert np.linalg.norm(state.keyframes[0].p_WC0 - state.keyframes[1].p_WC0) > 0.01
    assert state.belief.known
