"""Rigid motions that features share."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.vision.bodies.feature_displacements import Displacements, squared_distances
from crossmodal.systems.vision.bodies.motion_consensus import (
    find_consensus,
    rigid_motions,
    stillness,
)

RNG = np.random.default_rng(0)
SIGMA = 5e-4


def features(X: np.ndarray, on_body: int, still: int, strays: int) -> Displacements:
    count = on_body + still + strays
    p = RNG.uniform([0.8, -0.2, 0.3], [1.2, 0.2, 0.7], (count, 3))
    q = p.copy()
    q[:on_body] = p[:on_body] @ X[:3, :3].T + X[:3, 3]
    q[on_body + still :] += RNG.normal(scale=0.01, size=(strays, 3))
    C = np.tile(0.5 * SIGMA**2 * np.eye(3), (count, 1, 1))
    noise = np.sqrt(0.5) * SIGMA * RNG.normal(size=(2, count, 3))
    counts = np.full(count, 5)
    return Displacements(
        p_old=p + noise[0], p_new=q + noise[1], C_old=C, C_new=C, count_old=counts, count_new=counts
    )


def search(d: Displacements, seed: int = 0):
    still, _ = squared_distances(d.p_new - d.p_old, d.C_old + d.C_new)
    movers = np.nonzero(still > 20.0)[0]
    rng = np.random.default_rng(seed)
    return find_consensus(d, still, movers, rng, gate=16.27, support_gate=9.0, rotation_sigma=0.1)


def test_rigid_motions_are_recovered_exactly() -> None:
    X = se3.exp(np.array([0.5, -0.8, 1.1, 0.3, 0.2, -0.4]))
    p = RNG.normal(size=(6, 4, 3))
    assert_allclose(rigid_motions(p, p @ X[:3, :3].T + X[:3, 3]), np.tile(X, (6, 1, 1)), atol=1e-9)


@pytest.mark.parametrize(
    "twist", [(0, 0, 0, -0.006, 0.002, 0), (0, 0, 0.05, 0.0, -0.05, 0), (0.1, 0.05, 0, 0, 0, 0.02)]
)
def test_the_movers_are_found_among_still_and_stray_features(twist: tuple) -> None:
    X = se3.exp(np.array(twist, dtype=float))
    d = features(X, on_body=25, still=60, strays=10)
    consensus = search(d)
    assert consensus is not None
    moved = np.linalg.norm(d.p_new - d.p_old, axis=1) > 5 * SIGMA
    assert consensus.support[:25][moved[:25]].mean() > 0.9
    assert consensus.support[25:].sum() <= 1
    p = d.p_old[:25]
    error = p @ (consensus.X - X)[:3, :3].T + (consensus.X - X)[:3, 3]
    assert np.abs(error).max() < 3 * SIGMA


def test_the_same_seed_gives_the_same_motion() -> None:
    d = features(se3.exp(np.array([0, 0, 0.05, 0, -0.05, 0])), 20, 20, 20)
    first, second = search(d, 3), search(d, 3)
    assert first is not None
    assert second is not None
    assert_allclose(first.X, second.X, rtol=0, atol=0)


def test_a_still_world_has_no_consensus() -> None:
    assert search(features(np.eye(4), on_body=0, still=80, strays=0)) is None


def test_stillness_says_how_far_a_motion_had_come_at_each_tick() -> None:
    share = np.concatenate([np.zeros(10), np.linspace(0, 1, 6)])
    p, step = RNG.uniform(-0.2, 0.2, (15, 3)), np.tile([-0.004, 0.001, 0.0], (15, 1))
    seen = p[:, None] + share[None, :, None] * step[:, None] + SIGMA * RNG.normal(size=(15, 16, 3))
    information = np.tile(np.eye(3) / SIGMA**2, (15, 16, 1, 1))
    information[:, 4] = 0.0
    found, sigma = stillness(seen, information, p, step)
    assert np.isnan(found[4])
    errors = np.delete((found - share) / sigma, 4)
    assert np.abs(errors).max() < 4.0
    assert 0.3 < np.std(errors) < 2.0
