"""Which features may join the held body: those that take its handle along."""

from dataclasses import replace

import numpy as np
import pytest

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import HELD_BODY, STATIC_BODY, FeatureBelief, PoseBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision.bodies.body_tracker_state import TrackedBody
from crossmodal.systems.vision.bodies.feature_association import associate, merged
from crossmodal.systems.vision.bodies.feature_history import FeatureHistory, no_history, remember
from crossmodal.systems.vision.bodies.held_body import (
    start,
    takes_handle_along,
    without_features_of_others,
    without_nudges,
)
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig

CONFIG = RigidBodyMotionConfig()
WINDOW = whole_ticks(CONFIG.history.window, CONFIG.period)
SIGMA = 5e-4  # [m]
HANDLE = np.array([0.6, 0.1, 0.95])
CENTRE = np.array([0.65, 0.2, 0.75])  # Of the features, a box below the handle, [m].
RATE = np.array([0.0, 0.1, 0.0, 0.015, 0.0, -0.012])  # Of the lid about the handle, in W axes.


def seen(path: Array, rng: np.random.Generator) -> FeatureHistory:
    """The history of 20 features on a body that moves along `path` (H, 4, 4)."""
    p_BF = CENTRE - HANDLE + rng.uniform(-0.1, 0.1, (20, 3))
    history = no_history(WINDOW)
    for tick, X_WB in enumerate(path):
        p_WF = p_BF @ X_WB[:3, :3].T + X_WB[:3, 3] + SIGMA * rng.normal(size=p_BF.shape)
        features = FeatureBelief(
            ids=np.arange(20),
            uv=np.zeros((20, 2)),
            p_WF=p_WF,
            covariance=np.tile(SIGMA**2 * np.eye(3), (20, 1, 1)),
            age=np.full(20, tick),
        )
        history = remember(
            history, features, tick, floor=CONFIG.history.floor, memory=45, rest_samples=60.0
        )
    return history


def moving(rate: Array) -> Array:
    """Poses (H, 4, 4) of a frame at the handle: turning at rate[:3], going at rate[3:], in W."""
    path = np.tile(np.eye(4), (WINDOW, 1, 1))
    for X_WB, time in zip(path, CONFIG.period * np.arange(WINDOW), strict=True):
        X_WB[:3, :3] = se3.so3_exp(rate[:3] * time)
        X_WB[:3, 3] = HANDLE + rate[3:] * time
    return path


def held(path: Array, history: FeatureHistory) -> TrackedBody:
    prior = PoseBelief(X=np.ascontiguousarray(path[-1]), covariance=1e-4 * np.eye(6))
    body = start(CONFIG, prior, history, WINDOW)
    return replace(body, path=path)


@pytest.mark.parametrize("seed", range(5))
def test_features_of_the_held_body_join_even_if_the_hand_turns_on_the_handle(seed: int) -> None:
    history = seen(moving(RATE), np.random.default_rng(seed))
    misled = RATE + np.array([0.05, -0.08, 0.05, 0, 0, 0])
    rows = np.arange(20)
    for path in (moving(RATE), moving(misled)):
        assert takes_handle_along(CONFIG, held(path, history), history, rows)


@pytest.mark.parametrize("seed", range(5))
def test_features_of_a_box_that_slides_slower_than_its_lid_do_not(seed: int) -> None:
    sliding = np.array([0.0, 0.0, 0.0, 0.005, 0.0, 0.0])
    history = seen(moving(sliding), np.random.default_rng(seed))
    body = held(moving(RATE), history)
    assert not takes_handle_along(CONFIG, body, history, np.arange(20))


def test_what_the_closing_hand_has_nudged_does_not_move_with_it() -> None:
    rng = np.random.default_rng(0)
    nudged = np.tile(np.eye(4), (WINDOW, 1, 1))
    nudged[:, :3, 3] = HANDLE
    nudged[-15:, :3, 3] += np.linspace(0.0, 3e-3, 15)[:, None] * [1.0, 0.0, 0.0]
    nudged[-6:] = nudged[-1]
    history = seen(nudged, rng)
    before = associate(CONFIG, [carried(history)], history)
    assert np.sum(before.body == HELD_BODY) >= 10
    settled = without_nudges(CONFIG, history)
    assert np.mean(settled.samples[:, :-5].any(axis=1)) < 0.2
    after = associate(CONFIG, [carried(settled)], settled)
    assert np.all(after.body == STATIC_BODY)


def test_what_the_closing_hand_has_not_moved_keeps_its_past() -> None:
    resting = np.tile(np.eye(4), (WINDOW, 1, 1))
    resting[:, :3, 3] = HANDLE
    history = seen(resting, np.random.default_rng(0))
    kept = without_nudges(CONFIG, history)
    assert np.mean(kept.samples[:, 0]) > 0.8


def carried(history: FeatureHistory, sigma: float = 0.03) -> TrackedBody:
    """The body in a hand that has not moved; its rotation may be off by `sigma` [rad]."""
    still = np.tile(np.eye(4), (WINDOW, 1, 1))
    still[:, :3, 3] = HANDLE
    body = held(still, history)
    body.filter.P[:6, :6] = np.diag(np.repeat([sigma**2, 1e-5], 3))
    return body


def test_a_body_that_the_hand_has_carried_blindly_for_long_takes_no_single_feature() -> None:
    history = seen(moving(RATE), np.random.default_rng(0))
    body = held(moving(RATE), history)
    for sigma, joined in ((0.01, True), (0.2, False)):
        body.filter.P[:3, :3] = sigma**2 * np.eye(3)
        after = associate(CONFIG, [body], history)
        assert np.all((after.body == HELD_BODY) == joined)


def test_features_that_take_the_handle_out_of_the_hand_are_freed() -> None:
    history = seen(moving(RATE), np.random.default_rng(0))
    history = replace(history, body=np.full(20, HELD_BODY))
    body = held(moving(RATE), history)
    for way, freed in ((0.005, False), (0.08, True)):
        prior = PoseBelief(X=body.filter.X.copy(), covariance=1e-5 * np.eye(6))
        prior.X[:3, 3] += [way, 0.0, 0.0]
        (after,), left = without_features_of_others(CONFIG, [body], history, prior)
        assert np.all((left.body == STATIC_BODY) == freed)
        assert np.allclose(after.filter.X, prior.X if freed else body.filter.X)
        assert np.allclose(after.path[:-1], body.path[:-1])


def test_a_body_seen_for_long_is_not_taken_for_the_held_one() -> None:
    history = seen(moving(RATE), np.random.default_rng(0))
    history = replace(history, body=np.full(20, 2))
    hand = held(moving(RATE), history)
    for supported, bodies in ((WINDOW // 2, 1), (2 * WINDOW, 2)):
        other = replace(hand, body_id=2, supported=supported, reference_tick=WINDOW + 1)
        kept, _ = merged(CONFIG, [hand, other], history)
        assert len(kept) == bodies
