"""SE(3) as 4x4 homogeneous matrices, compiled: exponential, logarithm, adjoint and Jacobians.

Tangent vectors are ordered rotation first, (omega [rad], rho [m]), as Drake orders spatial vectors.
SciPy's `RigidTransform` has the same exponential and logarithm, and the tests compare against it;
they are compiled here because the joint filters call them thousands of times per tick.

Source: T. D. Barfoot, State Estimation for Robotics, 2017, chapter 7.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import perturb, relative_log

_SMALL = 1e-4  # Below this angle, [rad], series replace closed forms.


@hot
def skew(v: Array) -> Array:
    """The matrix (3, 3) with `skew(v) @ w == cross(v, w)`; `v` is (3,)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@hot
def exp(xi: Array) -> Array:
    """Pose (4, 4) of the tangent vector `xi` (6,)."""
    X = np.eye(4)
    perturb(X, xi, X)
    return X


@hot
def log(X: Array) -> Array:
    """Tangent vector (6,) of the pose (4, 4), angle in [0, pi]; `exp(log(X)) == X`."""
    xi = np.empty(6)
    relative_log(np.eye(4), X, xi)
    return xi


@hot
def so3_exp(omega: Array) -> Array:
    """Rotation matrix (3, 3) of the rotation vector `omega` (3,) [rad]."""
    xi = np.zeros(6)
    assign(xi[:3], omega)
    return exp(xi)[:3, :3].copy()


@hot
def so3_log(R: Array) -> Array:
    """Rotation vector (3,) [rad] of the rotation matrix (3, 3), angle in [0, pi]."""
    X = np.eye(4)
    assign(X[:3, :3], R)
    return log(X)[:3]


@hot
def inverse(X: Array) -> Array:
    """X_BA (4, 4) of X_AB (4, 4)."""
    Y = np.eye(4)
    R = np.ascontiguousarray(X[:3, :3].T)
    assign(Y[:3, :3], R)
    assign(Y[:3, 3], -(R @ np.ascontiguousarray(X[:3, 3])))
    return Y


@hot
def adjoint(X: Array) -> Array:
    """Ad_X (6, 6) with `X @ exp(xi) == exp(adjoint(X) @ xi) @ X`."""
    Ad = np.zeros((6, 6))
    R = np.ascontiguousarray(X[:3, :3])
    assign(Ad[:3, :3], R)
    assign(Ad[3:, 3:], R)
    assign(Ad[3:, :3], skew(X[:3, 3]) @ R)
    return Ad


def bracket(V: Array) -> Array:
    """ad_V (6, 6) with `bracket(V) @ xi == d(adjoint(exp(t V)) @ xi)/dt` at t = 0."""
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = skew(V[:3])
    ad[3:, :3] = skew(V[3:])
    return ad


@hot
def _so3_left_jacobian(omega: Array) -> Array:
    """The matrix J (3, 3) with exp(omega + d) ~ exp(J d) exp(omega); `omega` is (3,) [rad]."""
    angle = np.sqrt(omega @ omega)
    K = skew(omega)
    if angle < _SMALL:
        return np.eye(3) + 0.5 * K + K @ K / 6.0
    return (
        np.eye(3)
        + (1.0 - np.cos(angle)) / angle**2 * K
        + (angle - np.sin(angle)) / angle**3 * (K @ K)
    )


@hot
def _coupling(omega: Array, rho: Array) -> Array:
    """The lower left block Q (3, 3) of the left Jacobian (Barfoot 2017, eq. 7.86)."""
    angle = np.sqrt(omega @ omega)
    W = skew(omega)
    P = skew(rho)
    WP, PW = W @ P, P @ W
    WPW = WP @ W
    if angle < 1e-2:
        a2 = angle**2
        c1 = 1.0 / 6.0 - a2 / 120.0
        c2 = 1.0 / 24.0 - a2 / 720.0
        c3 = 1.0 / 120.0 - a2 / 2520.0
    else:
        sine, cosine = np.sin(angle), np.cos(angle)
        c1 = (angle - sine) / angle**3
        c2 = (angle**2 + 2.0 * cosine - 2.0) / (2.0 * angle**4)
        c3 = (2.0 * angle - 3.0 * sine + angle * cosine) / (2.0 * angle**5)
    return (
        0.5 * P
        + c1 * (WP + PW + WPW)
        + c2 * (W @ WP + PW @ W - 3.0 * WPW)
        + c3 * (WPW @ W + W @ WPW)
    )


@hot
def left_jacobian(xi: Array) -> Array:
    """J (6, 6) with exp(xi + d) ~ exp(J d) exp(xi); `xi` is (6,)."""
    J = np.zeros((6, 6))
    block = _so3_left_jacobian(xi[:3])
    assign(J[:3, :3], block)
    assign(J[3:, 3:], block)
    assign(J[3:, :3], _coupling(xi[:3], xi[3:]))
    return J


@hot
def right_jacobian(xi: Array) -> Array:
    """J (6, 6) with exp(xi + d) ~ exp(xi) exp(J d); `xi` is (6,)."""
    return left_jacobian(-xi)


def looking_at(eye: Array, target: Array, up: Array | None = None) -> Array:
    """Pose X_AC (4, 4) of a camera whose z points from `eye` (3,) at `target` (3,), both in A.

    Its -y points to the side of `up` (3,). That is by default A's z, so that the camera's x is
    level, or A's y for one that looks along z.
    """
    z = (target - eye) / np.linalg.norm(target - eye)
    if up is None:
        up = np.array([0.0, 0.0, 1.0] if abs(z[2]) < 0.999 else [0.0, 1.0, 0.0])
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X[:3, 3] = eye
    return X
