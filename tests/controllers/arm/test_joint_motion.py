"""Motions through postures: their knots, their speeds, and their ends."""

import numpy as np
import pytest
from known_arm import Q, arm_model
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.controllers.arm.joint_motion import along_line, rest_to_rest, resting
from crossmodal.maths.arrays import Array

START = 3.0
LIMITS = np.array([0.5, 0.6, 0.7, 0.8, 1.0, 1.0, 1.0])
STEPS = np.array([[0.6, -0.3, 0.0, 0.2, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9]])
PATH = np.vstack([Q, Q + STEPS[0], Q + STEPS[0] + STEPS[1]])


def speeds(postures: Array, dt: float) -> tuple[Array, Array]:
    """Of the joints (N, n) and of the end-effector (N,), by differences."""
    p = [arm_model().Evaluate(np.append(q, np.zeros(7))).X_WE[:3, 3] for q in postures]
    hand = np.linalg.norm(np.diff(np.array(p), axis=0), axis=1) / dt
    return np.abs(np.diff(postures, axis=0)) / dt, hand


@pytest.mark.parametrize(("speed", "by_hand"), [(0.1, True), (5.0, False)])
def test_speeds_stay_within_their_limits_and_reach_one(speed: float, by_hand: bool) -> None:
    """At 0.1 m/s the end-effector is what limits the first segment, at 5 m/s a joint is."""
    motion = rest_to_rest(PATH, arm_model(), START, speed, LIMITS)
    shares = []
    for begin, end in zip(motion.times[:-1], motion.times[1:], strict=True):
        times = np.linspace(begin, end, 400)
        joints, hand = speeds(np.array([motion.at(t) for t in times]), times[1] - times[0])
        shares.append([float((joints / LIMITS).max()), float(hand.max()) / speed])
        assert 0.95 < max(shares[-1]) <= 1.005
        assert joints[[0, -1]].max() < 0.01  # At rest.
    assert (np.argmax(shares[0]) == 1) == by_hand


def test_it_passes_its_knots_and_stays_at_its_ends() -> None:
    motion = rest_to_rest(PATH, arm_model(), START, 0.2, LIMITS)
    assert motion.times[0] == START
    for time, knot in zip(motion.times, PATH, strict=True):
        assert_allclose(motion.at(time), knot, atol=1e-9)
    assert_array_equal(motion.at(START - 1.0), PATH[0])
    assert_array_equal(motion.at(motion.end + 1.0), PATH[-1])
    between = motion.at(0.5 * (motion.times[1] + motion.times[2]))
    assert_allclose(between, 0.5 * (PATH[1] + PATH[2]))


def test_a_path_that_stays_takes_a_moment() -> None:
    motion = rest_to_rest(np.vstack([Q, Q]), arm_model(), START, 0.2, LIMITS)
    assert START < motion.end < START + 0.2
    assert_array_equal(motion.at(START + 0.02), Q)


def test_resting_is_no_motion() -> None:
    motion = resting(Q)
    assert motion.end == 0.0
    for time in (-1.0, 0.0, 5.0):
        assert_array_equal(motion.at(time), Q)


def test_a_line_is_passed_at_one_speed() -> None:
    line = np.linspace(PATH[0], PATH[1], 40)
    motion = along_line(line, arm_model(), START, 0.05, LIMITS)
    assert_allclose(motion.at(START), PATH[0])
    assert_allclose(motion.at(motion.end), PATH[1])
    times = np.arange(START, motion.end, 0.05)
    _, hand = speeds(np.array([motion.at(t) for t in times]), 0.05)
    assert_allclose(hand, 0.05, rtol=5e-3)


def test_an_eased_line_goes_from_rest_to_rest_and_back_over_what_it_passed() -> None:
    line = np.linspace(PATH[0], PATH[1], 40)
    motion = along_line(line, arm_model(), START, 0.05, LIMITS, eased=True)
    times = np.linspace(START, motion.end, 400)
    _, hand = speeds(np.array([motion.at(t) for t in times]), float(times[1] - times[0]))
    assert np.max(hand) == pytest.approx(0.05, rel=1e-2)
    assert max(hand[0], hand[-1]) < 1e-4
    early = START + 0.2 * (motion.end - START)  # 5.8 % of the way.
    assert_allclose(motion.back(early, motion.at(early)), [motion.at(early), *line[2::-1]])


def test_a_line_is_slower_where_a_joint_would_be_too_fast() -> None:
    line = np.linspace(PATH[0], PATH[1], 40)
    motion = along_line(line, arm_model(), START, 10.0, LIMITS)
    times = np.linspace(START, motion.end, 200)
    joints, _ = speeds(np.array([motion.at(t) for t in times]), float(times[1] - times[0]))
    assert np.all(joints <= LIMITS + 1e-9)
    assert np.max(joints / LIMITS) > 0.99


def test_the_way_back_has_no_posture_ahead_of_an_arm_that_lags() -> None:
    """Its command has just passed the second knot, the arm has not."""
    motion = rest_to_rest(PATH, arm_model(), START, 0.2, LIMITS)
    time = motion.times[1] + 0.01
    behind = PATH[1] - 0.01 * STEPS[0]
    assert_allclose(motion.back(time, behind), [behind, PATH[0]])
    beyond = PATH[1] + 0.01 * STEPS[1]
    assert_allclose(motion.back(time, beyond), [beyond, PATH[1], PATH[0]])
