"""Which features may join the body in the hand: those that take its handle along."""

from dataclasses import replace

import numpy as np
import pytest

from maths import se3
from systems.port_values import Array, FeatureBelief, PoseBelief
from systems.vision.body_level import RigidBodyMotionConfig, TrackedBody
from systems.vision.body_tracking import interacted_body
from systems.vision.feature_association import take_the_handle_along
from systems.vision.feature_history import FeatureHistory, no_history, remember

CONFIG = RigidBodyMotionConfig()
SIGMA = 5e-4  # [m]
HANDLE = np.array([0.6, 0.1, 0.95])
CENTRE = np.array([0.65, 0.2, 0.75])  # Of the features, a box below the handle, [m].
RATE = np.array([0.0, 0.1, 0.0, 0.015, 0.0, -0.012])  # Of the lid about the handle, in W axes.


def seen(path: Array, rng: np.random.Generator) -> FeatureHistory:
    """The history of 20 features on a body that moves along `path` (H, 4, 4)."""
    p_BF = CENTRE - HANDLE + rng.uniform(-0.1, 0.1, (20, 3))
    history = no_history(CONFIG.window)
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
            history, features, tick, floor=CONFIG.feature_floor, memory=45, rest_samples=60.0
        )
    return history


def moving(rate: Array) -> Array:
    """Poses (H, 4, 4) of a frame at the handle: turning at rate[:3], going at rate[3:], in W."""
    path = np.tile(np.eye(4), (CONFIG.window, 1, 1))
    for X_WB, time in zip(path, CONFIG.period * np.arange(CONFIG.window), strict=True):
        X_WB[:3, :3] = se3.so3_exp(rate[:3] * time)
        X_WB[:3, 3] = HANDLE + rate[3:] * time
    return path


def held(path: Array, history: FeatureHistory) -> TrackedBody:
    prior = PoseBelief(X=np.ascontiguousarray(path[-1]), covariance=1e-4 * np.eye(6))
    body = interacted_body(CONFIG, prior, history, CONFIG.window)
    return replace(body, path=path)


@pytest.mark.parametrize("seed", range(5))
def test_features_of_the_held_body_join_even_if_the_hand_turns_on_the_handle(seed: int) -> None:
    history = seen(moving(RATE), np.random.default_rng(seed))
    misled = RATE + np.array([0.05, -0.08, 0.05, 0, 0, 0])
    rows = np.arange(20)
    for path in (moving(RATE), moving(misled)):
        assert take_the_handle_along(CONFIG, held(path, history), history, rows)


@pytest.mark.parametrize("seed", range(5))
def test_features_of_a_box_that_slides_slower_than_its_lid_do_not(seed: int) -> None:
    sliding = np.array([0.0, 0.0, 0.0, 0.005, 0.0, 0.0])
    history = seen(moving(sliding), np.random.default_rng(seed))
    body = held(moving(RATE), history)
    assert not take_the_handle_along(CONFIG, body, history, np.arange(20))
