"""A plane from many pixels of a depth image, with what the sensor's noise leaves uncertain."""

from typing import NamedTuple

import cv2
import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot
from crossmodal.systems.flap.tracking.flap_region import InverseDepth


class PlaneFit(NamedTuple):
    """A plane m · p = 1 in the camera's frame C.

    Attributes:
        m_C: (3,), [1/m].
        pixels: That lie on it (h, w).
        size: Number of these.
        normal: Sum of the rays' squares r r^T (3, 3) over them.
        spread: Mean square of the residuals, [1/m^2].
    """

    m_C: Array
    pixels: Mask
    size: int
    normal: Array
    spread: float


@hot
def _normal_equations(image: InverseDepth, pixels: Mask) -> tuple[Array, Array, float, int]:
    """A^T A (3, 3), A^T w (3,), w^T w and number of the rays A of some pixels."""
    w, x, y = image.w, image.x, image.y
    normal, moment, square, total = np.zeros((3, 3)), np.zeros(3), 0.0, 0
    for row in range(w.shape[0]):
        count, sum_x, sum_w, xx, xw = 0, 0.0, 0.0, 0.0, 0.0
        for column in range(w.shape[1]):
            if pixels[row, column]:
                count += 1
                sum_x += x[column]
                sum_w += w[row, column]
                xx += x[column] * x[column]
                xw += x[column] * w[row, column]
                square += w[row, column] * w[row, column]
        total += count
        normal[0, 0] += xx
        normal[0, 1] += y[row] * sum_x
        normal[0, 2] += sum_x
        normal[1, 1] += y[row] * y[row] * count
        normal[1, 2] += y[row] * count
        moment[0] += xw
        moment[1] += y[row] * sum_w
        moment[2] += sum_w
    normal[2, 2] = total
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    return normal, moment, square, total


@hot
def near_plane(image: InverseDepth, allowed: Mask, m_C: Array, limit: float) -> Mask:
    """Which of the allowed pixels (h, w) are nearer to a plane (3,) than `limit`, [1/m]."""
    near = np.zeros_like(allowed)
    for row in range(image.w.shape[0]):
        of_row = m_C[1] * image.y[row] + m_C[2]
        for column in range(image.w.shape[1]):
            residual = image.w[row, column] - m_C[0] * image.x[column] - of_row
            near[row, column] = allowed[row, column] & (abs(residual) < limit)
    return near


def fit_plane(image: InverseDepth, pixels: Mask, least: int) -> PlaneFit | None:
    """The least squares plane of some pixels (h, w); None where there are less than `least`."""
    normal, moment, square, count = _normal_equations(image, pixels)
    if count < max(least, 3) or np.linalg.cond(normal) > 1e12:
        return None
    m = np.asarray(np.linalg.solve(normal, moment), dtype=float)
    return PlaneFit(m, pixels, count, normal, max(square - float(m @ moment), 0.0) / count)


def refine_plane(
    image: InverseDepth, start: PlaneFit, allowed: Mask, limit: float, least: int, rounds: int = 3
) -> PlaneFit | None:
    """The plane of all pixels near it; None where there are less than `least`.

    Args:
        allowed: Pixels (h, w) that may belong to it.
        limit: Of their residuals, [1/m].
        least: Number of pixels.
    """
    fit: PlaneFit | None = start
    for _ in range(rounds):
        if fit is not None:
            near = near_plane(image, allowed, fit.m_C, limit)
            fit = fit_plane(image, near, least)
    return fit


def plane_covariance(image: InverseDepth, fit: PlaneFit, sigma: float, correlated: int) -> Array:
    """Covariance (3, 3) of a fit's plane.

    The noise is a white one averaged over squares of `correlated` pixels, so that the covariance
    of A^T e is that of the regressors A averaged over the same squares.

    Args:
        sigma: Standard deviation of the inverse depth, [1/m].
        correlated: Side of the squares, [px].
    """
    rows, columns = np.flatnonzero(fit.pixels.any(axis=1)), np.flatnonzero(fit.pixels.any(axis=0))
    border = correlated // 2
    box = (
        slice(max(rows[0] - border, 0), rows[-1] + border + 1),
        slice(max(columns[0] - border, 0), columns[-1] + border + 1),
    )
    one = fit.pixels[box].astype(float)
    variance = max(fit.spread, sigma**2)
    size, none = (correlated, correlated), cv2.BORDER_CONSTANT
    regressors = (image.x[box[1]] * one, image.y[box[0], None] * one, one)
    A = np.array(
        [
            cv2.boxFilter(column, cv2.CV_64F, size, normalize=False, borderType=none).ravel()
            for column in regressors
        ]
    )
    inverse = np.linalg.inv(fit.normal)
    covariance = inverse @ (A @ A.T) @ inverse * (variance / correlated**2)
    return np.asarray(0.5 * (covariance + covariance.T))


def world_plane(fit: PlaneFit, covariance: Array, X_WC: Array) -> tuple[Array, float, Array]:
    """Normal n_W (3,) towards the camera, distance d [m] and their covariance (4, 4)."""
    length = float(np.linalg.norm(fit.m_C))
    unit = fit.m_C / length
    R = X_WC[:3, :3]
    n_W = -R @ unit
    d = float(n_W @ X_WC[:3, 3]) - 1.0 / length
    J = np.empty((4, 3))
    J[:3] = -R @ (np.eye(3) - np.outer(unit, unit)) / length
    J[3] = X_WC[:3, 3] @ J[:3] + unit / length**2
    return n_W, d, J @ covariance @ J.T
