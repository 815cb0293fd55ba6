import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from trimesh.creation import icosphere

from crossmodal.diagrams.clutter.training.grasp_data import body_at, ideal_depth
from crossmodal.diagrams.clutter.training.rasterise import rasterise
from crossmodal.diagrams.clutter.training.shapes import goods
from tests.systems.grasping.images import CAMERA, above


def test_the_larger_third_coordinate_is_in_front() -> None:
    square = np.array([[[0, 0, 1], [8, 0, 1], [0, 8, 1]], [[8, 8, 1], [0, 8, 1], [8, 0, 1]]])
    steep = np.array([[[0, 0, 0], [8, 0, 2], [0, 8, 0]], [[8, 8, 2], [0, 8, 0], [8, 0, 2]]])
    corners = np.concatenate([square, steep]).astype(float)
    front, owner = rasterise(corners, np.array([0, 0, 1, 1]), 12, 12)
    column = np.arange(12)
    assert_allclose(front[4, :9], np.maximum(1.0, 0.25 * column[:9]))
    assert_array_equal(owner[4, :9], column[:9] > 4)
    assert_array_equal(owner[:, 9:], -1)
    assert np.isneginf(front[:, 9:]).all()


def test_a_sphere_is_seen_from_above_as_it_is() -> None:
    sphere = icosphere(subdivisions=4, radius=30.0)
    corners = np.asarray(sphere.triangles) + np.array([50.0, 50.0, 0.0])
    front, _ = rasterise(corners, np.zeros(len(corners), int), 101, 101)
    v, u = np.indices(front.shape) - 50.0
    inside = u**2 + v**2 < 28.0**2
    assert_allclose(front[inside], np.sqrt(900.0 - u[inside] ** 2 - v[inside] ** 2), atol=0.3)
    assert np.isneginf(front[u**2 + v**2 > 900.0]).all()


def test_a_camera_sees_a_box_at_its_depth_and_the_table_beside() -> None:
    box = body_at(goods("black_box"), np.eye(4))
    depth, labels = ideal_depth([box], CAMERA, above(0.8))
    assert_allclose(depth[240, 320], 0.8 - 0.06)
    assert_allclose(depth[labels < 0], 0.8)
    focal, half = CAMERA.focal_x / 0.74, 0.5 * np.array([0.16, 0.11])
    assert (labels == 0).sum() / (4.0 * np.prod(focal * half)) - 1.0 < 0.02


def test_of_a_tilted_camera_the_table_has_its_depths() -> None:
    X_WC = above(0.8, 0.4)
    depth, _ = ideal_depth([], CAMERA, X_WC)
    rays = np.array([[(u - CAMERA.center_x) / CAMERA.focal_x, 0.0, 1.0] for u in (0, 320, 639)])
    points = X_WC[:3, 3] + depth[240, [0, 320, 639], None] * rays @ X_WC[:3, :3].T
    assert_allclose(points[:, 2], 0.0, atol=2e-3)
