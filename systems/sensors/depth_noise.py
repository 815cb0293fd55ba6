"""What a structured-light depth camera makes of an ideal depth image."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot
from crossmodal.maths.validation import check, number, require
from crossmodal.systems.sensors.randomness import random_bytes

Depth = npt.NDArray[np.float32]

_SIGMA_DEPTH = 0.4  # Where the deviation of the depth is smallest, [m].


@dataclass(kw_only=True)
class DepthNoiseConfig:
    range_min: float = number(0.4, at_least=1e-3, at_most=100.0, unit="m")  # Nearest return.
    range_max: float = number(3.5, at_least=1e-3, at_most=1000.0, unit="m")  # Farthest return.
    # Standard deviation at 0.4 m.
    sigma_base: float = number(1.2e-3, at_least=0.0, at_most=1.0, unit="m")
    # Its growth with (z - 0.4 m)^2.
    sigma_square: float = number(1.9e-3, at_least=0.0, at_most=1.0, unit="1/m")
    # Projector to infrared camera, along the image's +x.
    baseline: float = number(0.075, at_least=1e-4, at_most=10.0, unit="m")
    # Between neighbouring depths, per z^2.
    depth_step: float = number(1.0 / (8 * 580.0 * 0.075), at_least=1e-9, at_most=1.0, unit="1/m")
    # Side of the matched patch, odd.
    correlation_window: int = number(9, at_least=1, at_most=99, unit="px")
    # Share of what is behind a transparent surface that returns, and is taken for what is seen.
    through_glass: float = number(0.0, at_least=0.0, at_most=1.0)
    # By how much glass on the way makes that seem farther.
    glass_delay: float = number(2e-3, at_least=0.0, at_most=0.1, unit="m")
    # Ray to normal, beyond which nothing returns.
    grazing_angle: float = number(1.4, above=0.0, below=np.pi / 2, unit="rad")


def check_depth_noise(config: DepthNoiseConfig) -> None:
    """Refuses impossible values."""
    c, name = config, "DepthNoiseConfig"
    check(c, name)
    require(c.range_min < c.range_max, name, c, "range_max", "> range_min")
    require(c.correlation_window % 2 == 1, name, c, "correlation_window", "an odd number")


def depth_sigma(z: Array, sigma_base: float, sigma_square: float) -> Array:
    """Standard deviation [m] of one pixel's depth at depth `z` [m], quantisation included.

    Source: C. V. Nguyen, S. Izadi, D. Lovell, Modeling Kinect Sensor Noise for Improved 3D
    Reconstruction and Tracking, 3DIMPVT 2012, eq. 3 without its angular term.
    """
    return sigma_base + sigma_square * (z - _SIGMA_DEPTH) ** 2


def correlated_noise(rng: np.random.Generator, shape: tuple[int, int], window: int) -> Depth:
    """Standard normal noise (h, w) whose autocorrelation falls linearly to zero at `window` pixels.

    Neighbouring pixels match overlapping square patches, so their errors share what the patches
    share. A sum over a patch of uniform bytes is normal within one percent for `window` >= 3.

    Source of the 9 px patch: K. Konolige, P. Mihelich, Technical description of Kinect calibration,
    wiki.ros.org/kinect_calibration/technical.
    """
    white = random_bytes(rng, shape[0] * shape[1]).reshape(shape)
    summed = cv2.boxFilter(white, cv2.CV_32F, (window, window), normalize=False)
    sigma = window * np.sqrt((256.0**2 - 1.0) / 12.0)
    return (summed - np.float32(127.5 * window**2)) * np.float32(1.0 / sigma)


@hot
def returns(
    depth: Depth,
    intrinsics: tuple[float, float, float, float],
    depth_range: tuple[float, float],
    baseline: float,
    cos_grazing: float,
) -> Mask:
    """Which pixels (h, w) of an ideal depth image return anything.

    A point at depth z appears in the camera's column u and the projector's column u - f b / z.
    Going left from the image's right border, a pixel whose projector column was already reached
    lies in the shadow of something nearer.

    A slope is the smaller of the two one-sided differences, so that a depth edge does not make the
    flat surface beside it look grazing.

    Args:
        depth: Ideal depth (h, w), 0 too near, inf too far, [m].
        intrinsics: fx, fy, cx, cy, [px].
        depth_range: Nearest and farthest return, [m].
        baseline: Projector to camera, [m].
        cos_grazing: Cosine between ray and normal, below which nothing returns.
    """
    height, width = depth.shape
    fx, fy = np.float32(intrinsics[0]), np.float32(intrinsics[1])
    cx, cy = np.float32(intrinsics[2]), np.float32(intrinsics[3])
    nearest, farthest = np.float32(depth_range[0]), np.float32(depth_range[1])
    fb, limit = fx * np.float32(baseline), np.float32(cos_grazing**2)
    valid = np.zeros((height, width), dtype=np.bool_)
    facing = np.zeros(width, dtype=np.bool_)
    for v in range(1, height - 1):
        b = (np.float32(v) - cy) / fy
        for u in range(1, width - 1):
            z = depth[v, u]
            right, left = depth[v, u + 1] - z, z - depth[v, u - 1]
            below, above = depth[v + 1, u] - z, z - depth[v - 1, u]
            zu = fx * (left if abs(left) < abs(right) else right)
            zv = fy * (above if abs(above) < abs(below) else below)
            a = (np.float32(u) - cx) / fx
            along = zu * a + zv * b + z
            normal_square = zu * zu + zv * zv + along * along
            facing[u] = z * z >= limit * normal_square * (a * a + b * b + np.float32(1.0))
        reached = np.float32(np.inf)
        for u in range(width - 1, -1, -1):
            z = depth[v, u]
            column = np.float32(u) - fb / max(z, nearest)
            lit = column < reached
            reached = min(reached, column)
            valid[v, u] = lit and facing[u] and nearest <= z <= farthest
    return valid


@hot
def measure_depth(
    depth: Depth,
    valid: Mask,
    noise: Depth,
    depth_step: float,
    sigma_base: float,
    sigma_square: float,
) -> Depth:
    """The measured depth (h, w) [m] of an ideal one; 0 where nothing returns.

    Noise and quantisation act on the disparity, counted in its own steps: 1 / (depth_step z). The
    quantisation's own variance is taken out of the noise, so that the sum has the deviation
    `depth_sigma`.

    Source of the step, 1/8 px at a focal length of 580 px and a baseline of 75 mm: K. Konolige,
    P. Mihelich, Technical description of Kinect calibration.

    Args:
        depth: Ideal depth (h, w), [m].
        valid: `returns`.
        noise: Standard normal (h, w).
        depth_step: Between neighbouring depths, per z^2, [1/m].
        sigma_base: Of `depth_sigma`, [m].
        sigma_square: Of `depth_sigma`, [1/m].
    """
    height, width = depth.shape
    base, square = np.float32(sigma_base), np.float32(sigma_square)
    steps, quantisation = np.float32(1.0 / depth_step), np.float32(1.0 / 12.0)
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    z_base = np.float32(_SIGMA_DEPTH)
    measured = np.empty((height, width), dtype=np.float32)
    for v in range(height):
        for u in range(width):
            z = depth[v, u] if valid[v, u] else one
            disparity = steps / z
            sigma = (base + square * (z - z_base) * (z - z_base)) * disparity / z
            noisy = disparity + np.sqrt(max(sigma * sigma - quantisation, zero)) * noise[v, u]
            value = steps / max(np.floor(noisy + half), one)
            measured[v, u] = value if valid[v, u] else zero
    return measured
