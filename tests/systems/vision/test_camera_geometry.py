"""Projection, planes in depth images and their uncertainty."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths.pinhole import project
from crossmodal.systems.vision import camera_geometry

K = np.array([577.3, 577.3, 319.0, 239.0])
NOISE = np.array([1.2e-3, 1.9e-3, 0.4, 0.0])


def plane_image(normal: np.ndarray, distance: float) -> np.ndarray:
    """Depth of the plane normal . p = distance, [m]."""
    v, u = np.mgrid[0:480, 0:640]
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones_like(u, float)], axis=-1)
    return (distance / (rays @ normal)).astype(np.float32)


NORMAL = np.array([0.4, -0.3, 0.866])
PIXELS = np.array([[120.3, 80.7], [400.0, 300.0], [555.5, 410.25]])


def test_a_slanted_plane_is_fitted_exactly() -> None:
    depth = plane_image(NORMAL, 1.0)
    planes, _, valid = camera_geometry.fit_surfaces(depth, PIXELS, 6, NOISE, 1.0, 0.8)
    assert valid.all()
    p_CF, _, tangents = camera_geometry.surface_points(
        PIXELS, np.zeros((3, 2, 2)), planes, np.zeros(3), K
    )
    assert_allclose(p_CF @ NORMAL, 1.0, atol=1e-6)
    assert_allclose(np.einsum("nij,i->nj", tangents, NORMAL), 0.0, atol=1e-6)
    assert_allclose(project(p_CF, K), PIXELS, atol=1e-9)


def test_tangents_are_the_derivatives_of_the_surface_point() -> None:
    depth = plane_image(NORMAL, 1.0).astype(np.float64)
    step = 1e-3
    planes, _, _ = camera_geometry.fit_surfaces(
        depth.astype(np.float32), PIXELS, 6, NOISE, 1.0, 0.8
    )
    covariance, variances = np.zeros((3, 2, 2)), np.zeros(3)
    _, _, tangents = camera_geometry.surface_points(PIXELS, covariance, planes, variances, K)
    for axis in range(2):
        ends = []
        for sign in (1.0, -1.0):
            shift = np.zeros(2)
            shift[axis] = sign * step
            moved = planes.copy()
            moved[:, 0] += planes[:, 1:] @ shift
            p_CF, _, _ = camera_geometry.surface_points(
                PIXELS + shift, covariance, moved, variances, K
            )
            ends.append(p_CF)
        assert_allclose((ends[0] - ends[1]) / (2 * step), tangents[:, :, axis], atol=1e-8)


def test_covariance_matches_simulated_noise() -> None:
    rng = np.random.default_rng(0)
    ideal = plane_image(NORMAL, 1.0)
    sigma = NOISE[0] + NOISE[1] * (ideal - NOISE[2]) ** 2
    pixel_sigma = 0.1
    points = []
    for _ in range(400):
        depth = (ideal + sigma * rng.normal(size=ideal.shape)).astype(np.float32)
        # An error of the pixel is one of the point, along the surface.
        uv = PIXELS + pixel_sigma * rng.normal(size=PIXELS.shape)
        planes, variances, _ = camera_geometry.fit_surfaces(depth, uv, 4, NOISE, 1.0, 0.8)
        uv_covariance = np.tile(pixel_sigma**2 * np.eye(2), (3, 1, 1))
        p_CF, covariance, _ = camera_geometry.surface_points(
            uv, uv_covariance, planes, variances, K
        )
        points.append(p_CF)
    samples = np.array(points)
    for i in range(3):
        error = samples[:, i] - samples[:, i].mean(axis=0)
        squared = np.einsum("ni,ij,nj->n", error, np.linalg.inv(covariance[i]), error)
        assert 2.5 < squared.mean() < 3.5


def test_no_surface_at_depth_edges_holes_or_borders() -> None:
    depth = plane_image(np.array([0.0, 0, 1]), 1.0)
    depth[:, 300:] += 0.05
    depth[100:110, 100:110] = 0.0
    depth[200:230, 100:130] = np.inf
    uv = np.array([[300.0, 50.0], [105.0, 105.0], [115.0, 215.0], [3.0, 50.0], [200.0, 50.0]])
    _, _, valid = camera_geometry.fit_surfaces(depth, uv, 6, NOISE, 1.0, 0.8)
    assert valid.tolist() == [False, False, False, False, True]


def test_a_few_wrong_pixels_do_not_move_the_surface() -> None:
    rng = np.random.default_rng(1)
    depth = plane_image(NORMAL, 1.0)
    clean, _, _ = camera_geometry.fit_surfaces(depth, PIXELS, 6, NOISE, 1.0, 0.8)
    for u, v in PIXELS.round().astype(int):
        for du, dv in rng.integers(-6, 7, (15, 2)):
            depth[v + dv, u + du] += 0.03
    planes, _, valid = camera_geometry.fit_surfaces(depth, PIXELS, 6, NOISE, 1.0, 0.8)
    assert valid.all()
    assert_allclose(planes[:, 0], clean[:, 0], rtol=1e-5)


def test_patch_warps_are_identity_where_nothing_moved_and_scale_with_distance() -> None:
    planes = np.array([[1.0, 0.0, 0.0]])
    uv = np.array([[400.0, 300.0]])
    p_CF, _, tangents = camera_geometry.surface_points(
        uv, np.zeros((1, 2, 2)), planes, np.zeros(1), K
    )
    assert_allclose(camera_geometry.patch_warps(p_CF, tangents, K)[0], np.eye(2), atol=1e-12)
    assert_allclose(
        camera_geometry.patch_warps(0.5 * p_CF, tangents, K)[0], 2 * np.eye(2), atol=1e-12
    )


def test_incidence_is_the_angle_to_the_normal() -> None:
    depth = plane_image(NORMAL, 1.0)
    planes, _, _ = camera_geometry.fit_surfaces(depth, PIXELS, 6, NOISE, 1.0, 0.8)
    p_CF, _, tangents = camera_geometry.surface_points(
        PIXELS, np.zeros((3, 2, 2)), planes, np.zeros(3), K
    )
    expected = np.abs(p_CF @ NORMAL) / np.linalg.norm(p_CF, axis=1) / np.linalg.norm(NORMAL)
    assert_allclose(camera_geometry.incidence_cosines(p_CF, tangents), expected, atol=1e-4)
