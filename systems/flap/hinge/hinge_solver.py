"""The most likely hinge, given all keyframes and what was known before."""

from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import symmetric
from crossmodal.systems.flap.hinge.hinge_geometry import (
    CAMERA,
    CONTACT,
    DISPLACEMENTS,
    OFFSETS,
    POINT,
    ROWS,
    SIZE,
    TOUCH,
    HingeModel,
    corrected,
    linearise,
)
from crossmodal.systems.flap.hinge.hinge_keyframes import StackedKeyframes

_TAIL = 5.0  # Degrees of freedom of the Student distribution of a keyframe's residuals.


class HingePriors(NamedTuple):
    """What is known before anything was turned.

    Attributes:
        p_WQ: Point (3,) about which the displacements are, the first contact, [m].
        information: (21, 21), of the unknowns.
        mean: (21,); zero but for the contact's place and the displacements, the point on the axis
            relative to Q.
        contact_spread: Standard deviations of how the contact wanders along t and along n, [m].
    """

    p_WQ: Array
    information: Array
    mean: Array
    contact_spread: tuple[float, float]


def make_priors(
    p_WQ: Array,
    tool_size: float,
    offset: float,
    contact_spread: tuple[float, float],
    displacements: tuple[Array, Array],
) -> HingePriors:
    """Priors.

    Args:
        p_WQ: The first contact (3,), [m].
        tool_size: Standard deviation of the axis' distance from it, [m].
        offset: Of the faces and of the contact from the axis, along the normal, [m].
        displacements: Mean (12,) and covariance (12, 12) of the camera's and the finger's about Q.
    """
    mean, covariance = displacements
    information = np.zeros((SIZE, SIZE))
    information[POINT, POINT] = np.eye(3) / tool_size**2
    information[OFFSETS, OFFSETS] = np.eye(2) / offset**2
    information[CONTACT, CONTACT] = np.diag([tool_size**-2, offset**-2])
    information[DISPLACEMENTS, DISPLACEMENTS] = np.linalg.inv(covariance + 1e-10 * np.eye(12))
    means = np.zeros(SIZE)
    means[CONTACT] = tool_size, 0.0
    means[DISPLACEMENTS] = mean
    return HingePriors(p_WQ, information, means, contact_spread)


def _normal_equations(
    model: HingeModel, frames: StackedKeyframes, priors: HingePriors
) -> tuple[Array, Array, float]:
    """Information (21, 21) and gradient (21,) of the unknowns, and their cost.

    Outliers among the keyframes are weighed down.
    """
    r, J, by_measured = linearise(model, frames, priors.p_WQ)
    t, n = priors.contact_spread
    S = by_measured @ frames.covariance @ by_measured.transpose(0, 2, 1)
    S += np.diag(np.array([1e-9, 1e-9, n, t, t]) ** 2)
    L = np.linalg.cholesky(S)
    white = np.linalg.solve(L, np.concatenate([r[:, :, None], J], axis=2))
    square = np.sum(white[:, :, 0] ** 2, axis=1)
    rows = np.where(frames.seen, ROWS - 1.0, 1.0)
    weight = np.sqrt(np.minimum(1.0, (_TAIL + rows) / (_TAIL + square)))
    white = (white * weight[:, None, None]).reshape(-1, 1 + SIZE)
    r, J, x = white[:, 0], white[:, 1:], -priors.mean
    x[POINT] += model.p_W - priors.p_WQ
    for part, value in zip((OFFSETS, CONTACT, CAMERA, TOUCH), model[2:], strict=True):
        x[part] += value
    by_prior = priors.information @ x
    return J.T @ J + priors.information, J.T @ r + by_prior, float(r @ r + x @ by_prior)


def solve(
    model: HingeModel, frames: StackedKeyframes, priors: HingePriors, rounds: int
) -> tuple[HingeModel, Array]:
    """Gauss-Newton, damped where a step would make it worse.

    Returns:
        The model and the covariance (21, 21) of its corrections.
    """
    damping = 0.0
    H, g, cost = _normal_equations(model, frames, priors)
    for _ in range(rounds):
        step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
        trial = corrected(model, np.asarray(step, dtype=float))
        H_trial, g_trial, cost_trial = _normal_equations(trial, frames, priors)
        if cost_trial < cost * (1.0 + 1e-9) + 1e-9:
            done = cost - cost_trial < 1e-3
            model, H, g, cost = trial, H_trial, g_trial, cost_trial
            damping *= 0.1
            if done:
                break
        else:
            damping = max(10.0 * damping, 1e-3)
    return model, symmetric(np.asarray(np.linalg.inv(H), dtype=float))
