"""A plane from many pixels of a depth image, with what the sensor's noise leaves uncertain."""

from typing import NamedTuple

import cv2
import numba
import numpy as np

from maths.arrays import Array, Mask
from systems.flap.local_planes import InverseDepth


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


@numba.njit(cache=True)
def _normal_equations(
    w: Array, x: Array, y: Array, pixels: Mask
) -> tuple[Array, Array, float, int]:
    normal, moment, square, count = np.zeros((3, 3)), np.zeros(3), 0.0, 0
    ray = np.ones(3)
    for row in range(w.shape[0]):
        for column in range(w.shape[1]):
            if not pixels[row, column]:
                continue
            ray[0], ray[1] = x[row, column], y[row, column]
            for i in range(3):
                moment[i] += ray[i] * w[row, column]
                for j in range(3):
                    normal[i, j] += ray[i] * ray[j]
            square += w[row, column] ** 2
            count += 1
    return normal, moment, square, count


@numba.njit(cache=True)
def _inside(w: Array, x: Array, y: Array, allowed: Mask, m: Array, limit: Array) -> Mask:
    inside = np.zeros_like(allowed)
    for row in range(w.shape[0]):
        for column in range(w.shape[1]):
            if allowed[row, column]:
                e = w[row, column] - m[0] * x[row, column] - m[1] * y[row, column] - m[2]
                inside[row, column] = abs(e) < limit[row, column]
    return inside


def fit_plane(image: InverseDepth, pixels: Mask, least: int) -> PlaneFit | None:
    """The least squares plane of some pixels (h, w); None where there are less than `least`."""
    normal, moment, square, count = _normal_equations(image.w, image.x, image.y, pixels)
    if count < max(least, 3) or np.linalg.cond(normal) > 1e12:
        return None
    m = np.asarray(np.linalg.solve(normal, moment), dtype=float)
    return PlaneFit(m, pixels, count, normal, max(square - float(m @ moment), 0.0) / count)


def refine_plane(
    image: InverseDepth, start: PlaneFit, allowed: Mask, limit: Array, least: int, rounds: int = 3
) -> PlaneFit | None:
    """The plane of all pixels near it; None where there are less than `least`.

    Args:
        image: Part of a depth image.
        start: A first plane.
        allowed: Pixels (h, w) that may belong to it.
        limit: Of their residuals (h, w), [1/m].
        least: Number of pixels.
        rounds: Number of fits.
    """
    fit: PlaneFit | None = start
    for _ in range(rounds):
        if fit is not None:
            inside = _inside(image.w, image.x, image.y, allowed, fit.m_C, limit)
            fit = fit_plane(image, inside, least)
    return fit


def plane_covariance(image: InverseDepth, fit: PlaneFit, sigma: Array, correlated: int) -> Array:
    """Covariance (3, 3) of a fit's plane.

    The noise is a white one averaged over squares of `correlated` pixels, so that the covariance
    of A^T e is that of the regressors A averaged over the same squares.

    Args:
        image: Part of a depth image.
        fit: See there.
        sigma: Standard deviation of the inverse depth (h, w), [1/m].
        correlated: Side of the squares, [px].
    """
    rows, columns = np.flatnonzero(fit.pixels.any(axis=1)), np.flatnonzero(fit.pixels.any(axis=0))
    border = correlated // 2
    box = (
        slice(max(rows[0] - border, 0), rows[-1] + border + 1),
        slice(max(columns[0] - border, 0), columns[-1] + border + 1),
    )
    one = fit.pixels[box].astype(float)
    variance = max(fit.spread, float(np.sum(sigma[box] ** 2 * one)) / fit.size)
    size, none = (correlated, correlated), cv2.BORDER_CONSTANT
    regressors = (image.x[box] * one, image.y[box] * one, one)
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
