"""Corners against noise, and where they may lie."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.vision.features import feature_detection

EVERYWHERE = np.full((480, 640), 255, np.uint8)


def rgba(grey: np.ndarray) -> np.ndarray:
    grey = np.clip(np.round(grey), 0, 255).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])


def checkerboard() -> np.ndarray:
    v, u = np.mgrid[0:480, 0:640]
    return np.where((u // 40 + v // 40) % 2 == 0, 80.0, 160.0)


def find(image: np.ndarray, noise: np.ndarray, **options: object) -> np.ndarray:
    settings = {"existing_uv": np.zeros((0, 2)), "allowed": EVERYWHERE, "count": 200} | options
    return feature_detection.find_corners(
        image, noise=noise, min_distance=10, noise_factor=15.0, **settings
    )


@pytest.mark.parametrize("sigma", [1.0, 3.0, 8.0])
def test_the_noise_is_estimated_from_a_textured_image(sigma: float) -> None:
    rng = np.random.default_rng(0)
    _, noise = feature_detection.smooth_grey(
        rgba(checkerboard() + rng.normal(0, sigma, (480, 640)))
    )
    assert_allclose(noise, sigma, rtol=0.2)


def test_noise_depends_on_how_bright_the_image_is() -> None:
    rng = np.random.default_rng(4)
    dark = np.arange(480)[:, None] > np.full(640, 250)
    grey = np.where(dark, 25.0, 150.0) + np.where(dark, 6.0, 1.5) * rng.normal(size=dark.shape)
    image, noise = feature_detection.smooth_grey(rgba(grey))
    assert_allclose(noise[:200], 1.5, rtol=0.2)
    assert_allclose(noise[300:], 6.0, rtol=0.2)
    # A straight edge has no corner, and the noise on its dark side makes none.
    assert len(find(image, noise)) == 0
    assert len(find(image, np.full_like(noise, np.median(noise[:200])))) > 20


@pytest.mark.parametrize("sigma", [1.0, 5.0, 20.0])
def test_no_corner_is_born_from_noise(sigma: float) -> None:
    rng = np.random.default_rng(1)
    for level in (0.0, 60.0):
        grey = level + rng.normal(0, sigma, (480, 640))
        image, noise = feature_detection.smooth_grey(rgba(grey))
        assert len(find(image, noise)) == 0


def test_corners_of_a_checkerboard_are_found_in_noise() -> None:
    rng = np.random.default_rng(2)
    image, noise = feature_detection.smooth_grey(
        rgba(checkerboard() + rng.normal(0, 3.0, (480, 640)))
    )
    corners = find(image, noise)
    assert len(corners) > 150
    off = np.abs((corners + 0.5) / 40 - np.round((corners + 0.5) / 40)) * 40
    assert np.median(off.max(axis=1)) < 2.0


def test_corners_keep_their_distance_from_features_and_from_where_they_may_not_be() -> None:
    image, noise = feature_detection.smooth_grey(rgba(checkerboard()))
    first = find(image, noise, count=60)
    allowed = EVERYWHERE.copy()
    allowed[:, :320] = 0
    second = find(image, noise, existing_uv=first, allowed=allowed)
    assert len(second) > 20
    assert second[:, 0].min() >= 320
    distance = np.linalg.norm(first[:, None] - second, axis=2)
    assert distance.min() >= 10


def test_few_corners_are_spread_over_the_image() -> None:
    rng = np.random.default_rng(3)
    grey = checkerboard() + rng.normal(0, 3.0, (480, 640))
    image, noise = feature_detection.smooth_grey(rgba(grey))
    corners = find(image, noise, count=48)
    quadrant = (corners[:, 0] > 320) + 2 * (corners[:, 1] > 240)
    assert np.bincount(quadrant, minlength=4).min() >= 9


def test_depth_edges_and_holes_are_no_place_for_a_feature() -> None:
    depth = np.ones((480, 640), np.float32)
    depth[:, 300:] = 1.2
    depth[100:105, 100:105] = 0.0
    depth[200:205, 100:105] = np.inf
    mask = feature_detection.flat_depth_mask(depth, 5, 0.02)
    assert mask[50, 50] == 255
    assert mask[50, 500] == 255
    for v, u in ((50, 302), (102, 108), (207, 98)):
        assert mask[v, u] == 0


@pytest.mark.parametrize("slope", [0.02, 0.1, 0.3, 1.0, 3.0])
def test_the_steps_of_a_slanted_edge_are_no_corners(slope: float) -> None:
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:480, 0:640]
    grey = np.where(v - 240 > slope * (u - 320), 60.0, 160.0)  # Each pixel is one or the other.
    image, noise = feature_detection.smooth_grey(rgba(grey + rng.normal(0, 2.0, grey.shape)))
    inside = EVERYWHERE.copy()
    inside[:11], inside[-11:], inside[:, :11], inside[:, -11:] = 0, 0, 0, 0
    assert len(find(image, noise, allowed=inside)) == 0
