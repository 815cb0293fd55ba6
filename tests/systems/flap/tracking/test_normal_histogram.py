"""Clusters of normals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.systems.flap.tracking.normal_histogram import (
    BINS,
    cluster_normals,
    mean_normal,
    normal_histogram,
)

RADIUS, SHARE = 0.2, 0.08


def _tilted(degrees: float) -> Array:
    angle = np.deg2rad(degrees)
    return np.array([0.0, -np.sin(angle), -np.cos(angle)])


def _cloud(degrees: float, count: int, rng: np.random.Generator) -> Array:
    n = _tilted(degrees) + 0.07 * rng.normal(size=(count, 3))
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


def test_every_normal_falls_into_one_bin_by_its_x_and_y() -> None:
    n = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    counts = normal_histogram(n)
    assert counts.shape == (BINS, BINS)
    assert counts.sum() == 4
    assert counts[5, 5] == 2
    assert counts[10, 5] == 1
    assert counts[5, 0] == 1


@pytest.mark.parametrize("degrees", [20.0, 45.0, 80.0])
def test_two_orientations_are_two_clusters(degrees: float) -> None:
    rng = np.random.default_rng(3)
    n = np.vstack([_cloud(0.0, 300, rng), _cloud(degrees, 200, rng)])
    means, label = cluster_normals(n, RADIUS, SHARE)
    assert len(means) == 2
    assert_allclose(means[0], _tilted(0.0), atol=0.05)
    assert_allclose(means[1], _tilted(degrees), atol=0.05)
    assert np.mean(label[:300] == 0) > 0.85
    assert np.mean(label[300:] == 1) > 0.85


def test_one_orientation_is_one_cluster() -> None:
    n = _cloud(10.0, 500, np.random.default_rng(3))
    means, label = cluster_normals(n, RADIUS, SHARE)
    assert len(means) == 1
    assert np.mean(label == 0) > 0.9


def test_normals_of_neither_cluster_belong_to_none() -> None:
    rng = np.random.default_rng(3)
    stray = np.array([[np.sin(1.2), 0.0, -np.cos(1.2)]])
    n = np.vstack([_cloud(0.0, 300, rng), _cloud(45.0, 200, rng), stray])
    _, label = cluster_normals(n, RADIUS, SHARE)
    assert label[-1] == -1


def test_a_mean_normal_is_a_unit_vector() -> None:
    n = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert_allclose(mean_normal(n), np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
