import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics, project

CAMERA = Intrinsics(
    width=640, height=480, focal_x=500.0, focal_y=400.0, center_x=310.0, center_y=245.0
)


def looking_down(tilt: float) -> Array:
    """X_WC (4, 4), 1.2 m above the origin of W, turned about x by so much from straight down."""
    c, s = np.cos(tilt), np.sin(tilt)
    X_WC = np.eye(4)
    X_WC[:3, :3] = [[1.0, 0.0, 0.0], [0.0, -c, s], [0.0, -s, -c]]
    X_WC[2, 3] = 1.2
    return X_WC


def test_a_point_on_the_optical_axis_is_seen_at_the_principal_point() -> None:
    assert_allclose(CAMERA.project(np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 30.0]])), [[310, 245]] * 2)


def test_right_is_to_the_right_and_down_is_down_as_the_focal_lengths_say() -> None:
    pixels = CAMERA.project(np.array([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [0.2, -0.1, 2.0]]))
    assert_allclose(pixels, [[360, 245], [310, 285], [360, 225]])


def test_points_of_one_ray_are_one_pixel() -> None:
    rays = np.random.default_rng(0).normal([0.0, 0.0, 5.0], 1.0, (20, 3))
    assert_allclose(CAMERA.project(3.0 * rays), CAMERA.project(rays))


def test_what_is_not_in_front_of_the_camera_has_no_pixel() -> None:
    points = np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [0.1, 0.1, np.nan], [0.1, 0.1, 1.0]])
    seen = np.all(np.isfinite(CAMERA.project(points)), axis=1)
    assert seen.tolist() == [False, False, False, True]


def test_no_points_have_no_pixels() -> None:
    assert CAMERA.project(np.zeros((0, 3))).shape == (0, 2)


def test_the_intrinsics_as_a_vector_project_alike() -> None:
    assert CAMERA.vector().tolist() == [500.0, 400.0, 310.0, 245.0]
    points = np.random.default_rng(1).uniform(0.1, 1.0, (10, 3))
    assert_allclose(project(points, CAMERA.vector()), CAMERA.project(points))


def test_a_ray_goes_as_far_aside_as_the_focal_lengths_say() -> None:
    pixels = np.array([[310.0, 245.0], [360.0, 245.0], [310.0, 285.0]])
    assert_allclose(CAMERA.rays(pixels, np.eye(4)), [[0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]])
    # A camera that looks straight down sees -y of W below, wherever it is.
    rays = CAMERA.rays(pixels, looking_down(0.0))
    assert_allclose(rays, [[0, 0, -1], [0.1, 0, -1], [0, -0.1, -1]])


def test_what_lies_on_a_ray_is_seen_at_its_pixel() -> None:
    v, u = np.indices((480, 640)).reshape(2, -1)
    X_WC = looking_down(0.6)
    rays = CAMERA.image_rays(X_WC)
    assert rays.shape == (480, 640, 3)
    pixels = np.column_stack([u, v]).astype(float)
    assert_allclose(rays.reshape(-1, 3), CAMERA.rays(pixels, X_WC), atol=1e-12)
    p_CF = 0.7 * rays.reshape(-1, 3) @ X_WC[:3, :3]
    assert_allclose(p_CF[:, 2], 0.7)
    assert_allclose(CAMERA.project(p_CF), pixels, atol=1e-9)


@pytest.mark.parametrize("z", [0.4, 0.45, 0.7])
@pytest.mark.parametrize("tilt", [-0.5, 0.0, 0.4])
def test_a_level_plane_has_one_height_wherever_the_camera_looks(tilt: float, z: float) -> None:
    y = (np.arange(480) - 245.0) / 400.0
    depth = np.tile((1.2 - z) / (np.cos(tilt) + y[:, None] * np.sin(tilt)), 640)
    assert_allclose(CAMERA.heights(depth, looking_down(tilt), 0.4), z - 0.4, atol=1e-12)


def test_without_a_measurement_no_height_is_known() -> None:
    depth = np.full((480, 640), 0.8)
    depth[:4, 0] = [0.0, np.nan, np.inf, -1.0]
    heights = CAMERA.heights(depth, looking_down(0.0), 0.4)
    assert np.isnan(heights[:4, 0]).all()
    assert np.isfinite(heights).sum() == 480 * 640 - 4
