"""The hinge over simulated seeds, and what is not known of it."""

from dataclasses import replace

import numpy as np
import pytest
from flap_episode import DEGREES, LIMITS, Episode, run
from synthetic_flap import PERIOD, Laboratory

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.systems.flap.hinge.hinge_estimator import (
    HingeEstimatorConfig,
    HingeState,
    update_hinge,
)
from crossmodal.systems.port_values import UNKNOWN_FINGERTIP, HingeBelief

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
        state = update_hinge(state, contact, plane, lab.displacements(), lab.camera, config, LIMITS)
        if theta < 0.1:
            assert not state.belief.known
            assert np.isnan(state.belief.k_W).all()


def _moved_in_the_hand(rotation: Array, end: float) -> tuple[HingeBelief, Array]:
    """What is believed after 10 s of a tool that turns in the hand (3,) [rad] from 2 s to `end`.

    Returns the true axis (3,), too.
    """
    lab, state, config = Laboratory(0), HingeState(), HingeEstimatorConfig()
    still, known = lab.tool, lab.displacements(registered=True)
    for i in range(round(10.0 / PERIOD)):
        t = i * PERIOD
        R = se3.so3_exp(rotation * np.clip((t - 2.0) / (end - 2.0), 0.0, 1.0))
        lab.tool = replace(still, k_W=R @ still.k_W)
        contact, plane = lab.contact(lab.theta(t), 0.08), lab.plane(lab.theta(t))
        state = update_hinge(state, contact, plane, known, lab.camera, config, LIMITS)
    return state.belief, lab.tool.k_W


def test_a_hinge_that_was_found_before_the_tool_moved_in_the_hand_is_found_afresh() -> None:
    belief, k_W = _moved_in_the_hand(np.array([np.deg2rad(20.0), 0.0, 0.0]), 6.0)
    assert belief.known
    error = float(np.arcsin(np.linalg.norm(np.cross(k_W, belief.k_W))))
    assert error < np.deg2rad(5.0)
    assert error < 4.0 * np.sqrt(np.linalg.eigvalsh(belief.covariance[:3, :3])[-1])


@pytest.mark.parametrize("rotation", [np.array([0.0, 0.0, 0.14]), np.array([0.15, 0.0, 0.15])])
def test_no_hinge_is_believed_that_does_not_explain_what_was_seen(rotation: Array) -> None:
    belief, _ = _moved_in_the_hand(rotation, 5.0)
    assert not belief.known


def test_without_a_contact_the_hinge_stays_as_it_is() -> None:
    lab, config = Laboratory(0), HingeEstimatorConfig()
    state, known = HingeState(), lab.displacements()
    for i in range(150):
        theta = lab.theta(i * PERIOD)
        contact, plane = lab.contact(theta, 0.08), lab.plane(theta)
        state = update_hinge(state, contact, plane, known, lab.camera, config, LIMITS)
    assert state.belief.known
    after = update_hinge(
        state, UNKNOWN_FINGERTIP, lab.plane(0.3), known, lab.camera, config, LIMITS
    )
    assert after is state


def test_the_window_of_keyframes_is_bounded_and_keeps_the_first() -> None:
    lab, config = Laboratory(0), HingeEstimatorConfig(memory=10)
    state, known = HingeState(), lab.displacements()
    for i in range(0, 400, 3):
        theta = lab.theta(i * PERIOD)
        contact, plane = lab.contact(theta, 0.08), lab.plane(theta)
        state = update_hinge(state, contact, plane, known, lab.camera, config, LIMITS)
    assert len(state.keyframes) == 10
    assert np.linalg.norm(state.keyframes[0].p_WC0 - state.keyframes[1].p_WC0) > 0.01
    assert state.belief.known
