"""What tells a lost body from one that shifts in the hand."""

from collections.abc import Callable

import numpy as np
import pytest

from crossmodal.maths import se3
from crossmodal.systems.port_values import PoseBelief
from crossmodal.systems.proprioception.grasp_failure import (
    GraspFailure,
    GraspFailureConfig,
    compare,
)

CONFIG = GraspFailureConfig()
P_HA = np.array([0.0, 0.0, 0.1])
TICK = 1.0 / 15.0
X_WH_START = se3.exp(np.array([0.3, -0.2, 0.5, 0.6, 0.1, 0.8]))
Way = Callable[[float], float]


def along(way: float) -> np.ndarray:
    return se3.exp(np.array([0.0, 0.0, 0.0, -way, 0.0, 0.0]))


def seen(way: float) -> PoseBelief:
    return PoseBelief(X=along(way), covariance=1e-6 * np.eye(6))


def probabilities(hand: Way, body: Way, duration: float) -> np.ndarray:
    """That the grasp has failed, tick by tick, as hand and body go their ways [m] along -x."""
    failure = GraspFailure(X_WH=X_WH_START, body=seen(0.0))
    values = []
    for t in np.arange(TICK, duration, TICK):
        failure = compare(failure, along(hand(t)) @ X_WH_START, seen(body(t)), P_HA, CONFIG)
        values.append(failure.probability(CONFIG))
    return np.array(values)


def test_the_odds_are_those_of_two_gaussians() -> None:
    h, b = 0.04, 0.01
    failure = GraspFailure(X_WH=X_WH_START, body=seen(0.0))
    now = compare(failure, along(h) @ X_WH_START, seen(b), P_HA, CONFIG).now
    start = X_WH_START[:3, :3] @ P_HA + X_WH_START[:3, 3]
    J = np.hstack([-se3.skew(start), np.eye(3)])
    lost = 2e-6 * J @ J.T + CONFIG.rest**2 * np.eye(3)
    held = lost + (CONFIG.shift * h) ** 2 * np.eye(3)
    went, short = np.array([-b, 0, 0]), np.array([h - b, 0, 0])
    expected = 0.5 * short @ np.linalg.solve(held, short) - 0.5 * went @ np.linalg.solve(lost, went)
    expected += 0.5 * np.log(np.linalg.det(held) / np.linalg.det(lost))
    assert now == pytest.approx(expected, abs=1e-9)


def test_a_body_that_stays_behind_is_lost_within_ten_centimetres() -> None:
    values = probabilities(lambda t: 0.02 * t, lambda t: 0.02 * min(t, 3.0), 9.0)
    assert values[: int(3.0 / TICK)].max() < 0.05
    assert values[int(8.0 / TICK)] > 0.5


def test_a_handle_that_shifts_by_two_centimetres_is_still_held() -> None:
    def body(t: float) -> float:
        return 0.02 * t - 0.02 * np.clip(t - 3.0, 0.0, 1.0)

    assert probabilities(lambda t: 0.02 * t, body, 10.0).max() < 0.3


def test_a_slow_body_is_held_and_a_hand_at_rest_says_nothing() -> None:
    assert probabilities(lambda t: 0.004 * t, lambda t: 0.004 * t, 20.0).max() < 0.05
    resting = probabilities(lambda t: 0.0, lambda t: 0.0, 5.0)
    assert resting == pytest.approx(CONFIG.prior)


def test_a_lost_body_stays_lost_where_the_hand_turns_back_and_is_held_once_it_comes_along() -> None:
    def hand(t: float) -> float:
        return 0.02 * (t if t < 8.0 else 16.0 - t)

    lost = probabilities(hand, lambda t: 0.0, 11.0)
    assert lost[int(7.0 / TICK) :].min() > 0.5
    caught = probabilities(lambda t: 0.02 * t, lambda t: 0.02 * max(t - 8.0, 0.0), 16.0)
    assert caught[int(7.5 / TICK)] > 0.5
    assert caught[-1] < 0.05
