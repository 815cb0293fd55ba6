"""What a depth camera's calibration does to a plane that it sees."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.depth_camera import (
    DepthCamera,
    angle_variance,
    at_image,
    displacement_covariance,
    focal_tilt,
    seen_covariance,
    tilt_covariance,
    with_shift,
)
from crossmodal.systems.port_values import StampedImage

INTRINSICS = Intrinsics(
    width=640, height=480, focal_x=577.0, focal_y=577.0, center_x=319.5, center_y=239.5
)
X_WC = se3.exp(np.array([0.4, -0.9, 1.3, 0.2, -0.4, 0.9]))


def _camera(**errors: float) -> DepthCamera:
    return DepthCamera(intrinsics=INTRINSICS, X_WC=X_WC, pose_covariance=np.zeros((6, 6)), **errors)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def test_a_wrong_focal_length_tilts_a_plane_as_its_points_say() -> None:
    rng, share = np.random.default_rng(0), 1e-5
    R = X_WC[:3, :3]
    n = _unit(rng.normal(size=3))
    a = _unit(np.cross(n, rng.normal(size=3)))
    plane = 0.1 * rng.normal(size=(50, 2)) @ np.array([a, np.cross(n, a)]) + X_WC[:3, 3] + R[:, 2]
    p_C = (plane - X_WC[:3, 3]) @ R * [1.0 + share, 1.0 + share, 1.0]
    p_W = p_C @ R.T
    tilted = np.linalg.svd(p_W - p_W.mean(axis=0))[2][2]
    tilted *= np.sign(tilted @ n)
    assert_allclose(tilted - n, share * focal_tilt(_camera(), n), atol=1e-8)


def test_an_angle_errs_by_latency_with_its_rate_and_by_the_focal_length_with_its_tilt() -> None:
    late = _camera(latency_std=0.02)
    z, x, y = X_WC[:3, 2], X_WC[:3, 0], X_WC[:3, 1]
    assert angle_variance(late, y, z, z, 0.5) == pytest.approx(0.01**2)
    wide = _camera(focal_length_std=0.01)
    slanted = _unit(z + x)
    # A plane at 45 deg is tilted by half the share, one that faces the camera by nothing.
    assert angle_variance(wide, y, z, slanted, 0.0) == pytest.approx(0.005**2)
    assert angle_variance(wide, y, slanted, slanted, 0.0) == pytest.approx(0.0)
    covariance = tilt_covariance(wide, z, slanted)
    assert np.trace(covariance) == pytest.approx(0.005**2)


def test_a_camera_is_where_its_image_says_and_may_see_all_shifted() -> None:
    X, covariance = se3.exp(np.full(6, 0.1)), np.diag(np.linspace(1.0, 6.0, 6)) * 1e-6
    camera = _camera(registration_std=577e-3, depth_scale_std=0.01)
    there = at_image(camera, StampedImage(time=1.0, image=None, X_WC=X, covariance=covariance))
    assert_allclose(there.X_WC, X)
    shifted = with_shift(covariance, INTRINSICS, camera.registration_std)
    assert_allclose(there.pose_covariance, shifted)
    assert_allclose(shifted - covariance, np.diag([1e-6, 1e-6, 0.0, 0.0, 0.0, 0.0]), atol=1e-15)
    assert there.depth_scale_std == 0.01


def test_a_turned_frame_displaces_what_is_far_from_it() -> None:
    covariance = np.diag([0.0, 0.0, 0.01**2, 0.0, 0.0, 0.0])
    found = displacement_covariance(np.eye(4), covariance, np.array([0.5, 0.0, 0.0]))
    assert_allclose(found[3:, 3:], np.diag([0.0, 0.005**2, 0.0]), atol=1e-18)
    ray = 0.7 * X_WC[:3, 2]
    seen = seen_covariance(_camera(depth_scale_std=0.01), X_WC[:3, 3] + ray)
    assert_allclose(seen[3:, 3:], 1e-4 * np.outer(ray, ray))
    assert_allclose(seen[:3], 0.0)
