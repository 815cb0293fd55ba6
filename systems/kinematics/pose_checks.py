"""Which measured poses cannot be true, and why.

A measurement that no filter could use is skipped and counted by its reason. What is wrong with the
program that calls, an array of another shape, is raised.

Frames: P parent, B child.
"""

from enum import StrEnum
from typing import Any

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.keyframes.measurement_noise import UNKNOWN

FARTHEST = 1e6  # Largest distance between parent and child, [m].
_ORTHONORMAL = 1e-3  # Largest entry of R^T R - I.
_ROUNDING = 1e-6  # Of a correlation: asymmetry, and how far below zero an eigenvalue may be.
_EXACT = 1e-12  # Added to every variance, for exact ones, [rad^2, m^2].


class SkipReason(StrEnum):
    """Why a measurement was not used."""

    POSE_NOT_FINITE = "pose not finite"
    POSE_TOO_FAR = "pose more than 1000 km away"
    NO_ROTATION = "no rotation"
    COVARIANCE_NOT_FINITE = "covariance not finite"
    COVARIANCE_NOT_SYMMETRIC = "covariance not symmetric"
    COVARIANCE_INDEFINITE = "covariance not positive semi-definite"
    TIME_NOT_FINITE = "time not finite"
    TIME_BACKWARDS = "time before the last"
    TIME_AHEAD = "time far ahead of the last"
    REPEATED = "measurement repeated"
    NO_SOLUTION = "no finite solution"


_REASONS = tuple(SkipReason)


def as_array(value: Any, shape: tuple[int, ...], name: str, owner: str) -> Array:
    """The value as a contiguous array of floats.

    Args:
        value: An array, or what NumPy makes one of.
        shape: It must have.
        name: Of the argument, with what it is, for the error.
        owner: Named in the error.

    Raises:
        ValueError: for another shape, or what holds no real numbers.
    """
    try:
        array = np.asarray(value)
        if array.shape == shape and not np.iscomplexobj(array):
            return np.ascontiguousarray(array, dtype=float)
        found = f"shape {array.shape} of {array.dtype}"
    except (TypeError, ValueError):
        found = f"a {type(value).__name__}"
    raise ValueError(f"{owner}: {name} must be an array of shape {shape}, this is {found}")


def pose_array(value: Any, name: str, owner: str) -> Array:
    """A pose as an array (4, 4); see `as_array`."""
    hint = "; pass GetAsMatrix4()" if hasattr(value, "GetAsMatrix4") else ""
    return as_array(value, (4, 4), f"{name}, a pose [R p; 0 0 0 1]{hint},", owner)


def covariance_array(value: Any, name: str, owner: str) -> Array:
    """The covariance of a pose as an array (6, 6); see `as_array`."""
    return as_array(value, (6, 6), f"{name}, a covariance, rotation before translation,", owner)


@hot
def _pose_fault(X: Array) -> int:
    for i in range(4):
        for j in range(4):
            if not np.isfinite(X[i, j]):
                return 0
    if abs(X[0, 3]) > FARTHEST or abs(X[1, 3]) > FARTHEST or abs(X[2, 3]) > FARTHEST:
        return 1
    for i in range(3):
        for j in range(i + 1):
            s = X[0, i] * X[0, j] + X[1, i] * X[1, j] + X[2, i] * X[2, j]
            if abs(s - (1.0 if i == j else 0.0)) > _ORTHONORMAL:
                return 2
    determinant = (
        X[0, 0] * (X[1, 1] * X[2, 2] - X[1, 2] * X[2, 1])
        - X[0, 1] * (X[1, 0] * X[2, 2] - X[1, 2] * X[2, 0])
        + X[0, 2] * (X[1, 0] * X[2, 1] - X[1, 1] * X[2, 0])
    )
    off = abs(X[3, 0]) + abs(X[3, 1]) + abs(X[3, 2]) + abs(X[3, 3] - 1.0)
    return 2 if determinant < 0.0 or off > _ORTHONORMAL else -1


@hot
def _covariance_fault(P: Array) -> int:
    """What is infinite on the diagonal is unknown: its row and column do not count."""
    C, d, n = np.zeros((6, 6)), np.empty(6), int(np.int64(6))
    for i in range(6):
        if np.isnan(P[i, i]) or P[i, i] == -np.inf:
            return 3
        d[i] = P[i, i] + _EXACT
        if d[i] <= 0.0:
            return 5
    for i in range(6):
        for j in range(i):
            if d[i] == np.inf or d[j] == np.inf:
                continue
            if not (np.isfinite(P[i, j]) and np.isfinite(P[j, i])):
                return 3
            scale = np.sqrt(d[i]) * np.sqrt(d[j])
            if abs(P[i, j] - P[j, i]) > _ROUNDING * scale:
                return 4
            C[i, j] = P[i, j] / scale
        C[i, i] = 1.0 + _ROUNDING
    return 5 if np.isnan(cholesky.factor(C, n)) else -1


def pose_fault(X: Array) -> SkipReason | None:
    """Why a pose (4, 4) is none; None where it is one."""
    fault = _pose_fault(X)
    return None if fault < 0 else _REASONS[fault]


def covariance_fault(P: Array) -> SkipReason | None:
    """Why a covariance (6, 6) is none; None where it is one.

    It may be singular, zero, and infinite on the diagonal where nothing was measured.
    """
    fault = _covariance_fault(P)
    return None if fault < 0 else _REASONS[fault]


def time_fault(time: float, last: float) -> SkipReason | None:
    """Why a measurement's time [s] cannot be true after the last; None where it can."""
    if not np.isfinite(time):
        return SkipReason.TIME_NOT_FINITE
    return SkipReason.TIME_BACKWARDS if time < last else None


def finite(covariance: Array) -> Array:
    """The covariance with `UNKNOWN` where a variance is above it, correlated with nothing."""
    unknown = np.diagonal(covariance) > UNKNOWN
    if not unknown.any():
        return covariance
    known = np.where(unknown[:, None] | unknown, 0.0, covariance)
    return np.asarray(known + np.diag(np.where(unknown, UNKNOWN, 0.0)))
