"""Camera and arms against each other, from where a depth image shows the arms' own surfaces.

What is said of a point p is displaced by its error: of the camera's by D_c(p), of an arm's by
D_a(p), each (omega, delta) about Q, D(p) = delta + omega x (p - Q). The camera has an error s of
its depth's scale and f of its focal length on top, an arm the errors e of its joints' zeros. A
point p of an arm's surface with the normal n, which the camera sees at p_m, says

    n · (p_m - p) = n · (D_c(p) + (s + f M) (p - C) - D_a(p) - J(p) e),

with the camera's centre C, M the projection along its optical axis, J of the joints that carry it.

The calibrations of camera and arms are the prior of these errors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import project
from crossmodal.systems.depth_camera import DepthCamera, displacement_covariance
from crossmodal.systems.port_values import displacement_at
from crossmodal.systems.registration.robot_view import Joints, RobotImage, RobotView

SCALE, FOCAL, FIRST_ARM = 6, 7, 8  # Places among the unknowns; before them the camera's (6,).
_LEAST_COSINE = 0.2  # Between ray and normal, below which a surface is only grazed.


class Surface(NamedTuple):
    """Points of the robot's surface that the camera should see.

    Attributes:
        p_W: (N, 3), [m].
        n_W: Normals (N, 3) towards the camera.
        body: Indices (N,).
    """

    p_W: Array
    n_W: Array
    body: Array


class Unknowns(NamedTuple):
    """Which unknown is where.

    Attributes:
        arms: Slice of each arm, its six displacements and then its joints' zeros.
        size: Of them all.
    """

    arms: dict[str, slice]
    size: int


class Matches(NamedTuple):
    """Where the camera sees the robot's surface, and how that depends on the unknowns.

    Attributes:
        residual: n · (p_m - p), (N,), [m].
        A: Its Jacobian (N, D).
        body: Indices (N,).
    """

    residual: Array
    A: Array
    body: Array


def place_unknowns(joints: Mapping[str, int]) -> Unknowns:
    """The order of the unknowns, for arms with so many joints."""
    arms, start = {}, FIRST_ARM
    for name, count in joints.items():
        arms[name] = slice(start, start + 6 + count)
        start += 6 + count
    return Unknowns(arms, start)


def surface(image: RobotImage, X_WC: Array, bend: float) -> Surface:
    """The points of smooth surfaces in a rendered image.

    Args:
        X_WC: Of the camera (4, 4).
        bend: Largest second difference of the depth between neighbours; more is an edge, [m].
    """
    z, body = image.depth, image.body
    with np.errstate(invalid="ignore"):
        p = image.rays_C * z[..., None]
        inner = np.isfinite(z[1:-1, 1:-1])
        beside = (np.s_[1:-1, :-2], np.s_[1:-1, 2:]), (np.s_[:-2, 1:-1], np.s_[2:, 1:-1])
        for before, after in beside:
            inner &= (body[before] == body[1:-1, 1:-1]) & (body[after] == body[1:-1, 1:-1])
            inner &= np.abs(z[before] + z[after] - 2.0 * z[1:-1, 1:-1]) < bend
        across = p[1:-1, 2:] - p[1:-1, :-2]
        down = p[2:, 1:-1] - p[:-2, 1:-1]
    points = p[1:-1, 1:-1][inner]
    normals = np.cross(down[inner], across[inner])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = -np.sum(normals * points, axis=1) / np.linalg.norm(points, axis=1)
    faces = cosine > _LEAST_COSINE
    R = X_WC[:3, :3]
    return Surface(
        points[faces] @ R.T + X_WC[:3, 3], normals[faces] @ R.T, body[1:-1, 1:-1][inner][faces]
    )


def displacement_rows(
    points: Surface,
    view: RobotView,
    joints: Mapping[str, Joints],
    unknowns: Unknowns,
    p_WQ: Array,
) -> Array:
    """(N, 3, D): by how much the camera sees each point beside where its arm says it is."""
    rows = np.zeros((len(points.p_W), 3, unknowns.size))
    rows[:, :, :6] = displacement_at(points.p_W, p_WQ)
    rows[:, :, SCALE : FOCAL + 1] = distortion(view.X_WC, points.p_W)
    for name, part in unknowns.arms.items():
        mine = view.bodies(name)[points.body]
        rows[mine, :, part.start : part.start + 6] = -displacement_at(points.p_W[mine], p_WQ)
        carried = view.carried(name)[points.body[mine]]
        zeros = joints[name].displacements(points.p_W[mine]) * carried[:, None, :]
        rows[mine, :, part.start + 6 : part.stop] = -zeros
    return rows


def distortion(X_WC: Array, p_W: Array) -> Array:
    """(..., 3, 2): displacement of points per error of the depth's scale and of the focal length.

    A focal length that is taken to be too small moves what is seen away from the optical axis.
    """
    ray = p_W - X_WC[:3, 3]
    z = X_WC[:3, 2]
    lateral = ray - np.asarray(ray @ z)[..., None] * z
    return np.stack([ray, lateral], axis=-1)


def match(
    points: Surface,
    rows: Array,
    mean: Array,
    depth: Array,
    intrinsics: Array,
    X_WC: Array,
) -> Matches:
    """What the image shows where the surface is believed to be seen.

    Args:
        rows: Of `displacement_rows`.
        mean: Of the unknowns (D,).
        depth: Measured (H, W), [m]; 0, NaN and infinity are no return.
        intrinsics: Of it, (4,).
        X_WC: The camera's believed pose.
    """
    R, p_WC = X_WC[:3, :3], X_WC[:3, 3]
    expected = (points.p_W + rows @ mean - p_WC) @ R
    pixels = project(expected, intrinsics)
    rounded = np.rint(np.nan_to_num(pixels, nan=-1.0)).astype(int)
    height, width = depth.shape
    inside = np.all((rounded >= 0) & (rounded < [width, height]), axis=1)
    u, v = np.where(inside[:, None], rounded, 0).T
    z = depth[v, u].astype(float)
    inside &= np.isfinite(z) & (z > 0.0)
    z = np.where(inside, z, 1.0)
    rays = np.column_stack([u, v, np.ones_like(u)]) - [*intrinsics[2:], 0.0]
    seen = (rays / [*intrinsics[:2], 1.0] * z[:, None]) @ R.T + p_WC
    n = points.n_W
    residual = np.sum(n * (seen - points.p_W), axis=1)
    A = np.einsum("ni,nid->nd", n, rows)
    return Matches(residual[inside], A[inside], points.body[inside])


def match_weights(
    body: Array, e: Array, noise: float, images: int, surface: float, share: float
) -> Array:
    """What each match is worth (N,), [1/m^2], robust by Geman and McClure.

    A body's surface is off its model by one error along its normals, which no number of points
    makes less; neighbouring pixels share their noise.

    Args:
        body: Indices (N,).
        e: Residuals (N,), [m]; a weight is half at a width of three deviations.
        noise: Standard deviation of a pixel's depth along the normal, [m].
        images: Over which it is averaged.
        surface: Standard deviation of a body's surface, [m].
        share: Independent pixels per match.
    """
    weights = 1.0 / (1.0 + (e / (3.0 * noise)) ** 2) ** 2
    counts = np.bincount(body, weights=weights)
    variance = noise**2 / images / share + surface**2 * np.maximum(counts[body], 1.0)
    return np.asarray(weights / variance)


@dataclass(frozen=True, kw_only=True)
class CalibratedArm:
    """What is known beforehand of an arm.

    Attributes:
        X_WBase: Where its base is believed to be (4, 4).
        base_covariance: (6, 6) of xi in X_WBase exp(xi), rotation first, [rad, m].
        joint_offset_std: Of each joint's zero (n,), [rad].
    """

    X_WBase: Array
    base_covariance: Array
    joint_offset_std: Array


def prior_covariance(
    unknowns: Unknowns,
    p_WQ: Array,
    camera: DepthCamera,
    arms: Mapping[str, CalibratedArm],
) -> Array:
    """(D, D), what the calibrations say of the unknowns."""
    P = np.zeros((unknowns.size, unknowns.size))
    P[:6, :6] = displacement_covariance(camera.X_WC, camera.pose_covariance, p_WQ)
    P[SCALE, SCALE] = camera.depth_scale_std**2
    P[FOCAL, FOCAL] = camera.focal_length_std**2
    for name, part in unknowns.arms.items():
        arm, base = arms[name], slice(part.start, part.start + 6)
        P[base, base] = displacement_covariance(arm.X_WBase, arm.base_covariance, p_WQ)
        zeros = np.arange(base.stop, part.stop)
        P[zeros, zeros] = arm.joint_offset_std**2
    # A calibration that is specified as perfect still gets a variance, far below what is measured.
    return P + 1e-12 * np.eye(unknowns.size)


def readout(unknowns: Unknowns, p_WQ: Array, X_WC: Array, joints: Mapping[str, Joints]) -> Array:
    """(6 K, D): displacements near Q, of what the camera sees and of the end-effectors' bodies."""
    J = np.zeros((6 * (1 + len(unknowns.arms)), unknowns.size))
    J[:6, :6] = np.eye(6)
    J[3:6, SCALE : FOCAL + 1] = distortion(X_WC, p_WQ)
    for k, (name, part) in enumerate(unknowns.arms.items(), start=1):
        rows = slice(6 * k, 6 * k + 6)
        J[rows, part.start : part.start + 6] = np.eye(6)
        at_E = joints[name].jacobian
        J[rows, part.start + 6 : part.stop] = at_E
        J[rows.start + 3 : rows.stop, part.start + 6 : part.stop] = (
            displacement_at(p_WQ, joints[name].p_WE) @ at_E
        )
    return J
