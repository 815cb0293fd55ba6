"""Two flat parts that meet, and the noise that they show."""

import numpy as np
import pytest
from synthetic_flap import INTRINSICS

from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.tracking.flap_region import InverseDepth, crop, inverse_depth
from crossmodal.systems.flap.tracking.flap_tracking_config import (
    DepthSensorConfig,
    FlapTrackingConfig,
)
from crossmodal.systems.flap.tracking.tool_segmentation import (
    Parts,
    angle_between,
    measured_scale,
    segment,
)
from crossmodal.systems.sensors.depth_noise import correlated_noise

CONFIG = FlapTrackingConfig()
NOISE = 2e-3  # Standard deviation of the inverse depth, [1/m].


def folded(degrees: float, step: float, rng: np.random.Generator) -> InverseDepth:
    """A sheet 0.9 m away whose lower half is folded towards the camera.

    The lower half lies `step` [m] nearer than the upper one where they meet.
    """
    slope = np.tan(np.deg2rad(degrees))
    v, u = np.mgrid[:480, :640]
    y = (v - INTRINSICS.center_y) / INTRINSICS.focal_y
    # z = 0.9 - step - slope Y with Y = y z.
    w = np.where(y > 0.0, (1.0 + slope * y) / (0.9 - step), 1.0 / 0.9)
    inside = (np.abs(u - 320) < 60) & (np.abs(v - 240) < 48)
    noisy = w + NOISE * correlated_noise(rng, w.shape, CONFIG.sensor.correlation)
    depth = np.where(inside, 1.0 / noisy, 0.0)
    return inverse_depth(depth, INTRINSICS.vector(), (180, 300, 240, 400), None)


def _segmented(degrees: float, step: float, seed: int, scale: float = 1.4) -> Parts:
    image = folded(degrees, step, np.random.default_rng(seed))
    return segment(image, INTRINSICS.focal_x, CONFIG, scale)


def _angle(m: Array) -> float:
    """Of a plane's normal about the image's x axis, [deg]."""
    return float(np.rad2deg(np.arctan2(m[1], m[2])))


@pytest.mark.parametrize("step", [0.0, 0.004])
def test_a_flatly_folded_sheet_is_measured_without_a_bias(step: float) -> None:
    errors = []
    for seed in range(12):
        parts = _segmented(14.0, step, seed)
        assert len(parts.fits) == 2
        angles = sorted(_angle(fit.m_C) for fit in parts.fits)
        errors.append([angles[0], angles[1] - 14.0])
    bias, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert np.all(np.abs(bias) < 3.5 * spread / np.sqrt(len(errors)))
    assert np.all(np.abs(bias) < 0.5)


def test_the_planes_residuals_tell_the_noise_whatever_was_believed() -> None:
    sensor = DepthSensorConfig()
    scale, found = 2.0, []
    for seed in range(12):
        parts = _segmented(35.0, 0.0, seed, scale)
        assert len(parts.fits) == 2
        assert angle_between(parts.fits[0].m_C, parts.fits[1].m_C) > 0.5
        scale = measured_scale(parts, sensor)
        found.append(scale * sensor.growth)
    assert np.mean(found[2:]) == pytest.approx(NOISE, rel=0.1)
    nothing = segment(
        folded(0.0, 0.0, np.random.default_rng(0))._replace(valid=np.zeros((120, 160), bool)),
        INTRINSICS.focal_x, CONFIG, 1.0,
    )  # fmt: skip
    assert np.isnan(measured_scale(nothing, sensor))


@pytest.mark.parametrize("column", [0, 320, 639])
def test_a_strip_of_one_column_is_no_part(column: int) -> None:
    depth = np.zeros((480, 640), np.float32)
    depth[:, column] = 0.9
    camera = DepthCamera(intrinsics=INTRINSICS, X_WC=np.eye(4), pose_covariance=1e-12 * np.eye(6))
    x = 0.9 * (column - INTRINSICS.center_x) / INTRINSICS.focal_x
    image = crop(depth, None, camera, np.array([x, 0.0, 0.9]), 0.5)
    assert image is not None
    assert image.w.shape[1] == 2
    assert segment(image, INTRINSICS.focal_x, CONFIG, 1.0).fits == []
