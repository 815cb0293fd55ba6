"""A synthetic soft hand: six springs that stiffen, and chambers that answer to bending."""

import numpy as np

STIFFNESS = np.array([12.0, 12.0, 8.0, 2500.0, 2500.0, 4000.0])  # [N m/rad], [N/m].
LIMIT = np.array([0.25, 0.25, 0.25, 0.02, 0.02, 0.02])  # Where the springs saturate, [rad, m].
COUPLING = np.random.default_rng(7).normal(size=(6, 6)) * 0.15 + np.eye(6)
CHAMBERS = np.random.default_rng(8).normal(size=(4, 6)) * 3e3
PRELOAD = np.array([0.1, -0.2, 0.05, 2.0, -1.0, 3.0])


def load(bending: np.ndarray) -> np.ndarray:
    """Load (..., 6) on the hand that bends it by `bending` (..., 6)."""
    stretched = bending @ COUPLING.T
    return STIFFNESS * LIMIT * np.tan(np.clip(stretched / LIMIT, -1.4, 1.4))


def reading(
    bending: np.ndarray, preload: np.ndarray, rng: np.random.Generator, noise: float = 1.0
) -> np.ndarray:
    """Noisy inputs (..., 10) of the networks."""
    shape = bending.shape[:-1]
    wrench = load(bending) + preload
    wrench = wrench + noise * rng.normal(size=(*shape, 6)) * ([0.01] * 3 + [0.1] * 3)
    pressure = 6e4 + (bending / LIMIT) @ CHAMBERS.T + noise * 50 * rng.normal(size=(*shape, 4))
    return np.concatenate([wrench, pressure], axis=-1)


def bending_path(ticks: int, rng: np.random.Generator) -> np.ndarray:
    """Smooth bending (ticks, 6) from zero, within what the springs allow."""
    t = np.linspace(0, 1, ticks)[:, None]
    rate, phase = rng.uniform(2, 8, 6), rng.uniform(0, 2 * np.pi, 6)
    size = LIMIT * rng.uniform(0.2, 0.6, 6)
    return np.minimum(4 * t, 1) * size * (np.sin(rate * t + phase))


def interaction(ticks: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (ticks, 10) and labels (ticks, 6)."""
    labels = bending_path(ticks, rng)
    preload = PRELOAD * rng.uniform(0.8, 1.2, 6)
    return reading(labels, preload, rng), labels
