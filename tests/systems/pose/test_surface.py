"""Distances to a surface of samples, their gradients and rays, against closed forms."""

import numpy as np
import trimesh
from numpy.testing import assert_allclose
from targets import HALF, target

from crossmodal.systems.pose.surface import cast_rays, surface_distance
from crossmodal.systems.pose.target_model import TargetModel

NOWHERE = np.zeros(3)


def box_distance(p: np.ndarray) -> float:
    q = np.abs(p) - HALF
    return float(np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0))


def test_distances_to_a_box_are_those_of_its_faces_and_edges(box: TargetModel) -> None:
    rng = np.random.default_rng(0)
    m = np.empty(3)
    errors = []
    for p in rng.uniform(-1.3, 1.3, (2000, 3)) * HALF:
        distance = surface_distance(p, NOWHERE, box.surface, m)
        errors.append(abs(distance - box_distance(p)))
        assert_allclose(np.linalg.norm(m), 1.0, atol=1e-9)
    assert np.median(errors) < 1e-6
    assert np.quantile(errors, 0.95) < 2e-3


def test_the_gradient_is_that_of_the_distance(ball: TargetModel) -> None:
    rng = np.random.default_rng(1)
    m = np.empty(3)
    for direction in rng.normal(size=(200, 3)):
        direction /= np.linalg.norm(direction)
        distance = surface_distance(0.06 * direction, NOWHERE, ball.surface, m)
        assert_allclose(distance, 0.01, atol=5e-4)
        assert m @ direction > np.cos(np.deg2rad(6.0))


def test_beside_the_rim_of_a_thin_cup_outside_is_outside() -> None:
    """Of a wall of 1 mm, samples of its far side are often nearest: they would say inside."""
    profile = np.array([[0, 0], [30, 0], [30, 100], [29, 100], [29, 2], [0, 2]]) * 1e-3
    mesh = trimesh.creation.revolve(profile, sections=96)
    model = target(mesh)
    rng = np.random.default_rng(3)
    turns = rng.uniform(0.0, 2.0 * np.pi, 4000)
    r, z = rng.uniform(0.0, 0.05, 4000), rng.uniform(-0.02, 0.12, 4000)
    p = np.column_stack([r * np.cos(turns), r * np.sin(turns), z])
    walls = [((29, 30), (0, 100)), ((0, 30), (0, 2))]  # [mm]
    # Half a millimetre beside them, where the cup's 96 sides are not told from a circle.
    outside = np.ones(len(p), bool)
    for across, up in walls:
        in_r = (r > across[0] * 1e-3 - 5e-4) & (r < across[1] * 1e-3 + 5e-4)
        outside &= ~(in_r & (z > up[0] * 1e-3 - 5e-4) & (z < up[1] * 1e-3 + 5e-4))
    m = np.empty(3)
    distances = [surface_distance(q - model.middle, NOWHERE, model.surface, m) for q in p[outside]]
    assert outside.sum() > 3000
    assert np.mean(np.array(distances) < -5e-4) < 2e-3
    assert min(distances) > -3e-3


def test_of_a_thin_wall_the_side_counts_from_which_it_was_seen() -> None:
    model = target(trimesh.creation.box(extents=[0.2, 0.2, 0.002]))
    m = np.empty(3)
    p = np.array([0.02, 0.01, 0.0])
    for side in (1.0, -1.0):
        facing = np.array([0.0, 0.0, side])
        assert_allclose(surface_distance(p, facing, model.surface, m), -1e-3, atol=1e-9)
        assert_allclose(m, facing, atol=1e-9)
    sideways = np.array([1.0, 0.0, 0.0])
    assert np.isfinite(surface_distance(p, sideways, model.surface, m))
    assert (
        surface_distance(
            np.array([0.0, 0.0, -0.3]),
            np.array([0.0, 0.0, 1.0]),
            target(trimesh.creation.box(extents=[0.3] * 3)).surface,
            m,
        )
        == np.inf
    )


def test_rays_meet_a_ball_where_a_quadratic_says(ball: TargetModel) -> None:
    rng = np.random.default_rng(2)
    starts = rng.normal(size=(500, 3))
    starts *= 0.2 / np.linalg.norm(starts, axis=1, keepdims=True)
    aims = rng.uniform(-0.06, 0.06, (500, 3))
    directions = aims - starts
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    along = -np.einsum("ri,ri->r", starts, directions)
    nearest = np.sum(starts**2, axis=1) - along**2
    clear = np.abs(np.sqrt(nearest) - 0.05) > 2e-3
    true = np.where(nearest < 0.05**2, along - np.sqrt(np.maximum(0.05**2 - nearest, 0)), np.inf)
    found, samples = cast_rays(starts, directions, np.full(500, 1.0), ball.surface, True)
    assert np.array_equal(np.isfinite(found[clear]), np.isfinite(true[clear]))
    hit = np.isfinite(found) & clear
    assert np.quantile(np.abs(found[hit] - true[hit]), 0.95) < 5e-4
    assert np.array_equal(samples >= 0, np.isfinite(found))
    beyond, _ = cast_rays(starts, directions, np.full(500, 0.1), ball.surface, True)
    assert not np.isfinite(beyond).any()
