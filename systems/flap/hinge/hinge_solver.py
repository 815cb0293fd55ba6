"""The most likely hinge of a flap, from planes of its faces and from where a finger touches it.

With the axis k through p, a face that lies h off the axis is the plane n · x = d with

    k · n = 0,    n · p + h = d,

front and back with an h each. In the frame of the flap, t = n_f x k towards its free edge and n_f
out of its front, the finger touches it at (t, n) = (a, b), always the same place but for how the
contact wanders on the edge:

    t · (c - p) = a,    n_f · (c - p) = b;

where no face is seen, what remains is the circle |c - p - k k · (c - p)| = sqrt(a^2 + b^2). What
camera and finger report is displaced by small constant rotations omega and translations delta, the
calibrations' errors, about a point Q near the flap. What the camera shows is also stretched about Q
by the errors s of its depth's scale and f of its focal length: a point x seems to be at

    x + delta + omega x (x - Q) + (s I + f (I - z z^T)) (x - Q),

with the optical axis z. By f a face tilts by an angle that depends on how far the flap is turned.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import symmetric
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.hinge.hinge_keyframes import StackedKeyframes
from crossmodal.systems.port_values import displacement_at

# Places of the unknowns in the vector of corrections.
AXIS, POINT, OFFSETS, CONTACT, CAMERA, TOUCH, STRETCH = (
    slice(0, 2), slice(2, 5), slice(5, 7), slice(7, 9), slice(9, 15), slice(15, 21), slice(21, 23),
)  # fmt: skip
DISPLACEMENTS = slice(9, 21)  # The camera's and the finger's.
SIZE = 23
ROWS = 5  # Residuals of a keyframe: k · n, n · p + h - d, n_f · u - b, t · u - a, circle.


class HingeModel(NamedTuple):
    """All that is unknown.

    Attributes:
        k_W: Axis (3,), a unit vector; the flap is turned in the positive sense.
        p_W: Point on it (3,), [m].
        offsets: From the axis to the front and to the back face (2,), along their normals, [m].
        contact: (a, b), [m].
        camera: Displacement (6,) of what the camera sees, (omega, delta) about Q in W.
        touch: Displacement (6,) of what the finger touches.
        stretch: Errors s and f (2,) of its depth's scale and focal length, as shares of them.
    """

    k_W: Array
    p_W: Array
    offsets: Array
    contact: Array
    camera: Array
    touch: Array
    stretch: Array


def corrected(model: HingeModel, dx: Array) -> HingeModel:
    """The model after a correction (23,); that of the axis is in `normal_basis(k_W)`."""
    k = model.k_W + normal_basis(model.k_W).T @ dx[AXIS]
    parts = zip(model[1:], (POINT, OFFSETS, CONTACT, CAMERA, TOUCH, STRETCH), strict=True)
    return HingeModel(k / np.linalg.norm(k), *[value + dx[part] for value, part in parts])


def linearise(
    model: HingeModel, frames: StackedKeyframes, p_WQ: Array, z_W: Array
) -> tuple[Array, Array, Array]:
    """Residuals (K, 5), their Jacobian (K, 5, 23) by the unknowns and (K, 5, 7) by (n, d, c).

    Rows that a keyframe does not have are zero.
    """
    k, p, seen = model.k_W, model.p_W, frames.seen
    by_camera = _plane_displacements(frames, p_WQ, z_W)
    by_touch = -displacement_at(frames.p_WC, p_WQ)
    error = np.concatenate([model.camera, model.stretch])
    n, d = frames.n_W + by_camera[:, :3] @ error, frames.d + by_camera[:, 3] @ error
    u = frames.p_WC + by_touch @ model.touch - p
    n_f = frames.face[:, None] * n
    t = np.cross(n_f, k)
    across = u - np.outer(u @ k, k)
    radius = np.linalg.norm(across, axis=1)
    radial = across / radius[:, None]
    a, b = model.contact
    front = frames.face > 0.0
    h = np.where(front, model.offsets[0], model.offsets[1])

    r = np.zeros((len(n), ROWS))
    r[:, 0], r[:, 1] = n @ k, n @ p + h - d
    r[:, 2], r[:, 3] = np.sum(n_f * u, axis=1) - b, np.sum(t * u, axis=1) - a
    r[:, 4] = radius - np.hypot(a, b)

    by_measured = np.zeros((len(n), ROWS, 7))
    by_measured[:, 0, :3] = k
    by_measured[:, 1, :3], by_measured[:, 1, 3] = p, -1.0
    by_measured[:, 2, :3], by_measured[:, 2, 4:] = frames.face[:, None] * u, n_f
    by_measured[:, 3, :3] = frames.face[:, None] * np.cross(k, u)
    by_measured[:, 3, 4:] = t
    by_measured[:, 4, 4:] = radial

    J = np.zeros((len(n), ROWS, SIZE))
    by_k = np.zeros((len(n), ROWS, 3))
    by_k[:, 0], by_k[:, 3] = n, np.cross(u, n_f)
    by_k[:, 4] = -(u @ k)[:, None] * radial
    J[:, :, AXIS] = by_k @ normal_basis(k).T
    J[:, 1, POINT], J[:, 2, POINT], J[:, 3, POINT], J[:, 4, POINT] = n, -n_f, -t, -radial
    J[:, 1, OFFSETS] = np.column_stack([front, ~front])
    J[:, 2, 8], J[:, 3, 7] = -1.0, -1.0
    J[:, 4, CONTACT] = -model.contact / np.hypot(a, b)
    J[:, :, CAMERA] = by_measured[:, :, :4] @ by_camera[:, :, :6]
    J[:, :, STRETCH] = by_measured[:, :, :4] @ by_camera[:, :, 6:]
    J[:, :, TOUCH] = by_measured[:, :, 4:] @ by_touch

    unused = np.ones((len(n), ROWS), dtype=bool)
    unused[seen, :4] = False
    unused[~seen, 4] = False
    r[unused], J[unused], by_measured[unused] = 0.0, 0.0, 0.0
    return r, J, by_measured


def _plane_displacements(frames: StackedKeyframes, p_WQ: Array, z_W: Array) -> Array:
    """How the corrected (n, d) (K, 4, 8) change with the camera's displacement and stretch."""
    n, from_Q = frames.n_W, frames.d - frames.n_W @ p_WQ
    tilt = n - (n @ z_W)[:, None] * z_W  # (I - z z^T) n, of which the part along n does not turn.
    along = np.sum(n * tilt, axis=1)
    J = np.zeros((len(n), 4, 8))
    J[:, :3, :3] = -displacement_at(n, np.zeros(3))[:, :, :3]
    J[:, :3, 7] = tilt - along[:, None] * n
    J[:, 3, :3] = -np.cross(n, p_WQ)
    J[:, 3, 3:6] = -n
    J[:, 3, 6] = -from_Q
    J[:, 3, 7] = tilt @ p_WQ - along * frames.d
    return J


def front_normal(model: HingeModel, p_WC: Array, p_WQ: Array) -> Array:
    """The front's normal (3,) by the contact alone."""
    u = p_WC - displacement_at(p_WC, p_WQ) @ model.touch - model.p_W
    u = u - model.k_W * (model.k_W @ u)
    a, b = model.contact
    n = a * np.cross(model.k_W, u) + b * u
    return np.asarray(n / np.linalg.norm(n))


def first_model(frames: StackedKeyframes, spread: float, displacements: Array) -> HingeModel:
    """A model to begin with, from planes of the front and the first contact.

    Args:
        frames: At least two that show the front, turned by some degrees.
        spread: Standard deviation of the axis' distance from the first contact, [m].
        displacements: What is taken for those of camera and finger (12,).
    """
    front = frames.face > 0.0
    n, d, c = frames.n_W[front], frames.d[front], frames.p_WC[0]
    k = np.cross(n[0], n[-1])
    k /= np.linalg.norm(k)
    # How far the first contact is off each plane, in standard deviations.
    by_plane = np.append(c, -1.0)
    std = np.sqrt(by_plane @ frames.covariance[front][:, :4, :4] @ by_plane)
    A = np.vstack([n / std[:, None], np.eye(3) / spread])
    p = c + np.linalg.lstsq(A, np.append((d - n @ c) / std, np.zeros(3)), rcond=None)[0]
    u = c - p
    contact = np.array([np.cross(n[0], k) @ u, n[0] @ u])
    return HingeModel(k, p, np.zeros(2), contact, displacements[:6], displacements[6:], np.zeros(2))


_TAIL = 5.0  # Degrees of freedom of the Student distribution of a keyframe's residuals.


class HingePriors(NamedTuple):
    """What is known before anything was turned.

    Attributes:
        p_WQ: Point (3,) about which the displacements are, the first contact, [m].
        z_W: The camera's optical axis (3,).
        information: (23, 23), of the unknowns.
        mean: (23,); zero but for the contact's place and the displacements, the point on the axis
            relative to Q.
        contact_spread: Standard deviations of how the contact wanders along t and along n, [m].
    """

    p_WQ: Array
    z_W: Array
    information: Array
    mean: Array
    contact_spread: tuple[float, float]


def make_priors(
    p_WQ: Array,
    tool_size: float,
    offset: float,
    contact_spread: tuple[float, float],
    displacements: tuple[Array, Array],
    camera: DepthCamera,
) -> HingePriors:
    """Priors.

    Args:
        p_WQ: The first contact (3,), [m].
        tool_size: Standard deviation of the axis' distance from it, [m].
        offset: Of the faces and of the contact from the axis, along the normal, [m].
        displacements: Mean (12,) and covariance (12, 12) of the camera's and the finger's about Q.
        camera: With the errors of its depth's scale and focal length.
    """
    mean, covariance = displacements
    information = np.zeros((SIZE, SIZE))
    information[POINT, POINT] = np.eye(3) / tool_size**2
    information[OFFSETS, OFFSETS] = np.eye(2) / offset**2
    information[CONTACT, CONTACT] = np.diag([tool_size**-2, offset**-2])
    information[DISPLACEMENTS, DISPLACEMENTS] = np.linalg.inv(covariance + 1e-10 * np.eye(12))
    stds = np.array([camera.depth_scale_std, camera.focal_length_std])
    information[STRETCH, STRETCH] = np.diag(1.0 / (stds**2 + 1e-10))
    means = np.zeros(SIZE)
    means[CONTACT] = tool_size, 0.0
    means[DISPLACEMENTS] = mean
    return HingePriors(p_WQ, camera.X_WC[:3, 2], information, means, contact_spread)


class Solution(NamedTuple):
    """What `solve` finds.

    Attributes:
        model: The most likely one.
        covariance: (23, 23) of its corrections.
        cost: Of the model, by which it compares with others; an outlier's is bounded.
        misfit: Mean square of the residuals over their covariance, outliers and all: about one or
            less where the keyframes are of one hinge.
    """

    model: HingeModel
    covariance: Array
    cost: float
    misfit: float


def _normal_equations(
    model: HingeModel, frames: StackedKeyframes, priors: HingePriors
) -> tuple[Array, Array, float, float]:
    """Information (23, 23) and gradient (23,) of the unknowns, their cost and their misfit.

    Outliers among the keyframes are weighed down.
    """
    r, J, by_measured = linearise(model, frames, priors.p_WQ, priors.z_W)
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
    for part, value in zip((OFFSETS, CONTACT, CAMERA, TOUCH, STRETCH), model[2:], strict=True):
        x[part] += value
    by_prior = priors.information @ x
    cost, misfit = float(r @ r + x @ by_prior), float(square.sum() / rows.sum())
    return J.T @ J + priors.information, J.T @ r + by_prior, cost, misfit


def solve(
    model: HingeModel, frames: StackedKeyframes, priors: HingePriors, rounds: int
) -> Solution:
    """Gauss-Newton, damped where a step would make it worse.

    What the keyframes' covariances do not explain makes the model's covariance larger.
    """
    damping = 0.0
    H, g, cost, misfit = _normal_equations(model, frames, priors)
    for _ in range(rounds):
        step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
        trial = corrected(model, np.asarray(step, dtype=float))
        H_trial, g_trial, cost_trial, misfit_trial = _normal_equations(trial, frames, priors)
        if cost_trial < cost * (1.0 + 1e-9) + 1e-9:
            done = cost - cost_trial < 1e-3
            model, H, g, cost, misfit = trial, H_trial, g_trial, cost_trial, misfit_trial
            damping *= 0.1
            if done:
                break
        else:
            damping = max(10.0 * damping, 1e-3)
    covariance = symmetric(np.asarray(np.linalg.inv(H), dtype=float))
    return Solution(model, max(misfit, 1.0) * covariance, cost, misfit)
