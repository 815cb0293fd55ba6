import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths.pinhole import Intrinsics, project

CAMERA = Intrinsics(
    width=640, height=480, focal_x=500.0, focal_y=400.0, center_x=310.0, center_y=245.0
)


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
