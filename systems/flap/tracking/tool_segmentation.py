"""The tool's one or two flat parts in a region of a depth image."""

from typing import NamedTuple

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.systems.flap.tracking.flap_region import (
    InverseDepth,
    LocalPlanes,
    fit_local_planes,
    normals,
)
from crossmodal.systems.flap.tracking.flap_tracking_config import (
    DepthSensorConfig,
    FlapTrackingConfig,
)
from crossmodal.systems.flap.tracking.normal_histogram import cluster_normals
from crossmodal.systems.flap.tracking.plane_fit import PlaneFit, fit_plane, refine_plane

_ROUNDS = 4  # Of fitting two planes, each to its own side.
_CLEAR_ROUNDS = 2  # Of fitting both where they are apart.
_GAPS = np.ones((21, 21), np.uint8)  # Between a part's pixels, which are its own, [px].
_BORDER = 5  # Side of the square by which a part is eroded, [px].


class Parts(NamedTuple):
    """The flat parts that were found.

    Attributes:
        fits: None to two planes, the one with most pixels first.
        image: In which they were found.
        sigma: Standard deviation of a pixel's inverse depth, [1/m]. That of a depth, growth z^2, is
            one of the inverse depth that is the same at all depths.
    """

    fits: list[PlaneFit]
    image: InverseDepth
    sigma: float


def measured_scale(parts: Parts, sensor: DepthSensorConfig) -> float:
    """How much larger the noise is than `sensor` says, by the planes' residuals; NaN without one.

    The median of all residuals between a part's pixels: what a gate has cut off is among them.
    """
    image, residuals = parts.image, []
    for fit in parts.fits:
        part = cv2.morphologyEx(fit.pixels.astype(np.uint8), cv2.MORPH_CLOSE, _GAPS) > 0
        part &= image.valid
        residuals.append(np.abs(image.residuals(fit.m_C)[part]))
    if not residuals:
        return float("nan")
    return MEDIAN_TO_SIGMA * float(np.median(np.concatenate(residuals))) / sensor.growth


def segment(
    image: InverseDepth, focal: float, config: FlapTrackingConfig, noise_scale: float
) -> Parts:
    """The flat parts in a region.

    The normals' histogram says how many there are, and where each of them is; then each plane is
    fitted to all pixels on its side of the line in which both meet. Planes that differ by less than
    `least_angle` are one.

    Args:
        image: The region, with nothing valid but what may be the tool.
        focal: [px]
        noise_scale: How much larger the noise is than `config.sensor` says.
    """
    sigma = noise_scale * config.sensor.growth
    nothing = Parts([], image, sigma)
    if int(image.valid.sum()) < config.least_points:
        return nothing
    z = 1.0 / float(np.median(image.w[image.valid]))
    window = round(config.window * focal / z)
    planes = fit_local_planes(image, window, config.stride, config.window_share)
    smooth = planes.mean_square < (config.window_residual * sigma) ** 2
    smooth &= image.valid[planes.rows, planes.columns]
    if int(smooth.sum()) < config.least_normals:
        return nothing
    planes = LocalPlanes(
        planes.m_C[smooth], planes.mean_square[smooth], planes.rows[smooth], planes.columns[smooth]
    )
    _, label = cluster_normals(normals(planes.m_C), config.cluster_radius, config.cluster_share)
    seeds = [_paint(image, planes, label == k, config.stride) for k in range(label.max() + 1)]
    fits = _fit_parts(image, seeds, sigma, config)
    return Parts(sorted(fits, key=lambda fit: -fit.size), image, sigma)


def angle_between(a: Array, b: Array) -> float:
    """Between two vectors (3,), [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _paint(image: InverseDepth, planes: LocalPlanes, chosen: Mask, stride: int) -> Mask:
    """The pixels (h, w) about the centres of some windows."""
    pixels = np.zeros_like(image.valid)
    rows, columns = planes.rows[chosen], planes.columns[chosen]
    steps: Ids = np.arange(stride) - stride // 2
    height, width = pixels.shape
    around = np.clip(rows[:, None, None] + steps[:, None], 0, height - 1)
    pixels[around, np.clip(columns[:, None, None] + steps[None, :], 0, width - 1)] = True
    return pixels & image.valid


def _fit_parts(
    image: InverseDepth, seeds: list[Mask], sigma: float, config: FlapTrackingConfig
) -> list[PlaneFit]:
    limit, least = config.pixel_gate * sigma, config.least_points
    starts = [fit_plane(image, pixels, 3) for pixels in seeds]
    if len(starts) == 2 and starts[0] is not None and starts[1] is not None:
        pair = _fit_two(image, [starts[0], starts[1]], seeds, limit, least)
        if len(pair) == 2 and angle_between(pair[0].m_C, pair[1].m_C) >= config.least_angle:
            return pair
        starts = [*pair[:1]]
    whole = [refine_plane(image, fit, image.valid, limit, least) for fit in starts[:1] if fit]
    inner = [
        refine_plane(image, fit, interior(fit.pixels, image.valid), limit, least) or fit
        for fit in whole
        if fit is not None
    ]
    return inner


def _fit_two(
    image: InverseDepth, pair: list[PlaneFit], seeds: list[Mask], limit: float, least: int
) -> list[PlaneFit]:
    """Both planes, each of the connected pixels on its side; one where the other has too few.

    Near the line in which both meet a pixel's depth does not say whose it is, and whoever takes it
    is tilted: in the end only pixels count at which the planes are apart.
    """
    for _ in range(_ROUNDS):
        refined = [
            refine_plane(image, fit, side, limit, least, rounds=1)
            for fit, side in zip(pair, _sides(image, pair, seeds), strict=True)
        ]
        found = [fit for fit in refined if fit is not None]
        if len(found) < 2:
            return found
        pair = found
    for _ in range(_CLEAR_ROUNDS):
        clear = np.abs(_difference(image, pair)) > limit
        inner = [
            refine_plane(image, fit, interior(fit.pixels & clear, seed & clear), limit, least)
            for fit, seed in zip(pair, seeds, strict=True)
        ]
        both = [fit for fit in inner if fit is not None]
        if len(both) < 2:
            return pair[:1]
        pair = [
            refine_plane(image, fit, side, limit, least, rounds=1) or fit
            for fit, side in zip(both, _sides(image, both, seeds), strict=True)
        ]
    return both


def _difference(image: InverseDepth, pair: list[PlaneFit]) -> Array:
    """By how much (h, w) the first of two planes is nearer than the other, [1/m]."""
    m = pair[0].m_C - pair[1].m_C
    return np.asarray(m[0] * image.x + (m[1] * image.y + m[2])[:, None])


def interior(pixels: Mask, seed: Mask) -> Mask:
    """The connected pixels (h, w) about a seed, without their border.

    Across a gap begins another part, and beside an edge the edge's own face.
    """
    _, labels = cv2.connectedComponents(pixels.astype(np.uint8), connectivity=4)
    counts = np.bincount(labels[seed & pixels], minlength=2)
    chosen = (labels == 1 + int(np.argmax(counts[1:]))).astype(np.uint8)
    square, none = np.ones((_BORDER, _BORDER), np.uint8), cv2.BORDER_CONSTANT
    return np.asarray(cv2.erode(chosen, square, borderType=none, borderValue=0) > 0)


def _sides(image: InverseDepth, fits: list[PlaneFit], seeds: list[Mask]) -> list[Mask]:
    """The pixels on each plane's side of the line in which two planes meet.

    Where both have their seeds on one side, the nearer plane's pixels: they do not meet there.
    """
    beyond = _difference(image, fits) > 0.0
    shares = [float(np.mean(beyond[pixels])) for pixels in seeds]
    if (shares[0] > 0.5) != (shares[1] > 0.5):
        first = beyond if shares[0] > 0.5 else ~beyond
    else:
        distances = [np.abs(image.residuals(fit.m_C)) for fit in fits]
        first = distances[0] < distances[1]
    return [image.valid & first, image.valid & ~first]
