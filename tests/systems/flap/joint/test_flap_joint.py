"""The flap by joint filters."""

from dataclasses import replace

import numpy as np
import pytest
from flap_episode import DEGREES, LIMITS, Episode, run
from numpy.testing import assert_allclose
from synthetic_flap import PERIOD, Laboratory

from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.systems.flap.joint.flap_joint import see_at_rest, update_joint
from crossmodal.systems.flap.joint.flap_joint_model import (
    FlapJointConfig,
    FlapJointModel,
    FlapJointState,
    flap_pose,
    least_rotation,
    read_joint_angle,
    without_position,
)
from crossmodal.systems.port_values import UNKNOWN_FINGERTIP, unseen


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    return [run(Laboratory(seed), filtered=True) for seed in range(8)]


def test_the_least_rotation_turns_one_vector_into_the_other() -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        a, b = rng.normal(size=(2, 3))
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        R = least_rotation(a, b)
        assert_allclose(R @ a, b, atol=1e-12)
        assert_allclose(R @ np.cross(a, b), np.cross(a, b), atol=1e-12)
    assert_allclose(least_rotation(a, a), np.eye(3))


def test_a_plane_gives_two_rotations_and_a_contact_three_positions() -> None:
    lab = Laboratory(0)
    plane, contact = lab.plane(0.5), lab.contact(0.5, 0.08)
    n0 = lab.tool.frame(0.0)[:, 1]
    correlated_n = 1e-6 * np.eye(3)
    X, covariance, correlated = flap_pose(
        n0, plane.n_W, plane.covariance[:3, :3], correlated_n, contact, 1e-3, 0.5
    )
    assert_allclose(X[:3, :3] @ n0, plane.n_W, atol=1e-9)
    assert_allclose(X[:3, 3], contact.p_WC)
    std = np.sqrt(np.linalg.eigvalsh(covariance[:3, :3]))
    assert std[2] == pytest.approx(0.5, rel=1e-3)
    assert std[1] < 0.03
    n_B = X[:3, :3].T @ plane.n_W
    assert n_B @ covariance[:3, :3] @ n_B == pytest.approx(0.25, rel=1e-3)
    assert np.all(np.linalg.eigvalsh(covariance - correlated) > -1e-15)


@pytest.mark.parametrize("name", ["axis", "point", "theta", "L1", "L2"])
def test_errors_are_not_larger_than_their_covariances_say(
    episodes: list[Episode], name: str
) -> None:
    values = [episode.nees[name][-1] for episode in episodes]
    assert sum(values) < chi_square_bounds(DEGREES[name] * len(values), 0.999)[1]


def test_the_joint_is_found(episodes: list[Episode]) -> None:
    assert np.median([episode.at("axis", np.deg2rad(30.0)) for episode in episodes]) < 0.02
    assert np.median([episode.error["L2"][-1] for episode in episodes]) < 0.003
    assert np.median([episode.rms("theta", True) for episode in episodes]) < np.deg2rad(1.0)
    assert np.median([episode.rms("theta", False) for episode in episodes]) < np.deg2rad(2.0)


def test_a_first_touch_that_is_sensed_beside_the_contact_does_not_turn_the_flap() -> None:
    """One tick after the first, the taxels find the contact 2 mm farther on: nothing has moved."""
    ends = []
    for offset in (0.0, 0.002):
        lab, state = Laboratory(0), FlapJointState()
        model, known = FlapJointModel(FlapJointConfig(), LIMITS, lab.camera), lab.displacements()
        for i in range(round(8.0 / PERIOD)):
            theta = lab.theta(i * PERIOD)
            contact = lab.contact(theta, 0.08 if theta > 0.0 else 0.0)
            if i == 0:
                moved = contact.p_WC + offset * lab.tool.frame(0.0)[:, 1]
                contact = replace(contact, p_WC=moved)
            state = update_joint(state, lab.plane(theta), contact, known, i * PERIOD, model)
        ends.append(read_joint_angle(state, model).theta)
    assert abs(ends[1] - ends[0]) < np.deg2rad(0.2)


def test_the_angle_counts_from_where_the_flap_was_seen_before_it_was_touched() -> None:
    """A loose flap yields by 3 deg before its touch is sensed."""
    squares = []
    for seed in range(6):
        lab, state = Laboratory(seed), FlapJointState()
        model, known = FlapJointModel(FlapJointConfig(), LIMITS, lab.camera), lab.displacements()
        theta = 0.0
        for i in range(round(10.0 / PERIOD)):
            t = i * PERIOD
            touching = t > 2.0
            theta = lab.theta(t) + np.deg2rad(3.0) * touching
            contact = lab.contact(theta, 0.08) if touching else UNKNOWN_FINGERTIP
            state = update_joint(state, lab.plane(theta), contact, known, t, model)
        angle = read_joint_angle(state, model)
        assert abs(angle.theta - theta) < np.deg2rad(1.5)
        squares.append((angle.theta - theta) ** 2 / angle.variance)
    assert sum(squares) < chi_square_bounds(6, 0.999)[1]


def test_what_was_seen_before_the_flap_moved_is_forgotten() -> None:
    lab, state, config = Laboratory(0), FlapJointState(), FlapJointConfig()
    for theta in np.repeat([0.0, np.deg2rad(10.0)], 20):
        state = see_at_rest(state, lab.plane(float(theta)), config)
    assert state.rest is not None
    assert state.rest.ticks == 20


def _jerked(seed: int, seen: bool) -> tuple[float, list[float], list[float]]:
    """Of a flap that is let go at 29 deg and jerked by 20 deg: how far it is off, before and after.

    Returns the last error [rad], its squares over the variances since it was let go, and the
    variances.
    """
    lab, state = Laboratory(seed), FlapJointState()
    model, known = FlapJointModel(FlapJointConfig(), LIMITS, lab.camera), lab.displacements()
    error, squares, variances = np.nan, [], []
    for i in range(round(10.0 / PERIOD)):
        t = i * PERIOD
        touching = t < 8.3
        theta = lab.theta(t) if touching else lab.theta(8.3) + np.deg2rad(20.0)
        contact = lab.contact(theta, 0.08) if touching else UNKNOWN_FINGERTIP
        plane = lab.plane(theta, hidden=0.0) if touching or seen else unseen("dark")
        state = update_joint(state, plane, contact, known, t, model)
        if not touching:
            angle = read_joint_angle(state, model)
            assert angle.measured == seen
            error = angle.theta - theta
            squares.append(error**2 / angle.variance)
            variances.append(angle.variance)
    return error, squares, variances


def test_a_flap_that_nobody_touches_is_followed_where_it_is_seen() -> None:
    ends = [_jerked(seed, seen=True) for seed in range(8)]
    assert max(abs(error) for error, _, _ in ends) < np.deg2rad(3.0)
    assert sum(squares[-1] for _, squares, _ in ends) < chi_square_bounds(8, 0.999)[1]


def test_a_flap_that_nobody_touches_or_sees_is_ever_less_certain() -> None:
    for seed in range(2):
        _, squares, variances = _jerked(seed, seen=False)
        assert np.all(np.diff(variances) > 0.0)
        assert squares[-1] < chi_square_bounds(1, 0.999)[1]


def test_a_pose_without_a_position_has_the_rotation_alone() -> None:
    lab = Laboratory(0)
    n, correlated_n = lab.tool.frame(0.0)[:, 1], 1e-6 * np.eye(3)
    touched = flap_pose(n, n, correlated_n, correlated_n, lab.contact(0.0, 0.0), 1e-3, 0.5)
    pose = without_position(touched)
    assert_allclose(pose.covariance[:3, :3], touched.covariance[:3, :3])
    assert np.all(np.isinf(np.diag(pose.covariance)[3:]))
    assert np.all(pose.correlated[3:] == 0.0)
