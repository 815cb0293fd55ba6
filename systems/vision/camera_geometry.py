"""Pinhole projection and local surfaces of a depth image, with their uncertainty, compiled.

Pixels are (u right, v down) with integer coordinates at pixel centres; frame C has x right, y down,
z forward. An intrinsics vector is (fx, fy, cx, cy), [px].

A plane's inverse depth w = 1/z is an affine function of the pixel, so that a least squares fit of
w = w0 + wu (u - u0) + wv (v - v0) over a window describes a planar surface exactly.
"""

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot


def transform(X_AB: Array, p_B: Array) -> Array:
    """Points (..., 3) of frame B expressed in A."""
    return p_B @ X_AB[:3, :3].T + X_AB[:3, 3]


@hot
def _fit_plane(
    depth: npt.NDArray[np.float32],
    u0: float,
    v0: float,
    radius: int,
    stride: int,
    plane: Array,
    gate: float,
) -> tuple[Array, Array, float, int]:
    """One least squares pass over the pixels within `gate` of the `plane` (all if gate < 0).

    Only every `stride`-th pixel of every `stride`-th row counts.

    Returns the plane (3,), its unit-noise covariance (3, 3), the residuals' mean square, and the
    number of pixels used.
    """
    normal = np.zeros((3, 3))
    moment = np.zeros(3)
    square = 0.0
    used = 0
    cu, cv = int(np.floor(u0 + 0.5)), int(np.floor(v0 + 0.5))
    for v in range(cv - radius, cv + radius + 1, stride):
        for u in range(cu - radius, cu + radius + 1, stride):
            z = depth[v, u]
            if not (z > 0.0 and z < 1e3):
                continue
            w = 1.0 / z
            du, dv = u - u0, v - v0
            if gate > 0.0 and abs(w - plane[0] - plane[1] * du - plane[2] * dv) > gate:
                continue
            used += 1
            normal[0, 0] += 1.0
            normal[0, 1] += du
            normal[0, 2] += dv
            normal[1, 1] += du * du
            normal[1, 2] += du * dv
            normal[2, 2] += dv * dv
            moment[0] += w
            moment[1] += w * du
            moment[2] += w * dv
            square += w * w
    unit = np.zeros((3, 3))
    fit = np.zeros(3)
    if used < 6:
        return fit, unit, np.inf, used
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    if np.linalg.det(normal) <= 1e-9 * normal[0, 0] * normal[1, 1] * normal[2, 2]:
        return fit, unit, np.inf, used
    unit = np.asarray(np.linalg.inv(normal))
    fit = unit @ moment
    return fit, unit, max(float(square - fit @ moment), 0.0) / (used - 3), used


@hot
def fit_surfaces(
    depth: npt.NDArray[np.float32],
    uv: Array,
    radius: int,
    noise: Array,
    correlated_pixels: float,
    min_share: float,
) -> tuple[Array, Array, Mask]:
    """The plane around each pixel, robust against missing returns and depth edges.

    Args:
        depth: Image (H, W), [m]; 0, NaN or infinity is no return.
        uv: Pixels (N, 2).
        radius: The window is 2 radius + 1 wide, [px].
        noise: (s0 [m], s1 [1/m], z0 [m], floor [m]) of one pixel's standard deviation
            s0 + s1 (z - z0)^2; the floor is an error that averaging does not remove.
        correlated_pixels: Number of neighbours whose noise is one and the same.
        min_share: Share of the window that has to return a depth and lie on the plane.

    Returns:
        Planes (N, 3) in inverse depth, variances (N,) of w0, and whether there is a surface (N,).
    """
    count = uv.shape[0]
    planes = np.zeros((count, 3))
    variances = np.zeros(count)
    valid = np.zeros(count, dtype=np.bool_)
    height, width = depth.shape
    window = (2 * radius + 1) ** 2
    sparse = (radius + 1) ** 2
    for i in range(count):
        u, v = uv[i]
        if not (radius + 1 < u < width - radius - 2 and radius + 1 < v < height - radius - 2):
            continue
        plane, unit, mean_square, used = _fit_plane(depth, u, v, radius, 2, planes[i], -1.0)
        if used < min_share * sparse or plane[0] <= 0.0:
            continue
        for _ in range(2):
            z = 1.0 / plane[0]
            sigma = (noise[0] + noise[1] * (z - noise[2]) ** 2) / z**2
            plane, unit, mean_square, used = _fit_plane(depth, u, v, radius, 1, plane, 4.0 * sigma)
            if used < min_share * window or used == window or plane[0] <= 0.0:
                break
        if used < min_share * window or plane[0] <= 0.0:
            continue
        z = 1.0 / plane[0]
        sigma = (noise[0] + noise[1] * (z - noise[2]) ** 2) / z**2
        planes[i] = plane
        variances[i] = max(mean_square, sigma**2) * correlated_pixels * unit[0, 0]
        variances[i] += (noise[3] / z**2) ** 2
        valid[i] = True
    return planes, variances, valid


def surface_points(
    uv: Array, uv_covariance: Array, planes: Array, variances: Array, intrinsics: Array
) -> tuple[Array, Array, Array]:
    """Points on surfaces, their covariance, and how they move with the pixel.

    p = r(u, v) / w(u, v) with the ray r = ((u - cx)/fx, (v - cy)/fy, 1).

    Returns:
        p_CF (N, 3), covariance (N, 3, 3) in C, and the tangents dp/d(u, v) (N, 3, 2), [m/px].
    """
    rays = np.ones((len(uv), 3))
    rays[:, :2] = (uv - intrinsics[2:]) / intrinsics[:2]
    z = 1.0 / planes[:, 0]
    p_CF = rays * z[:, None]
    tangents = -rays[:, :, None] * (planes[:, None, 1:] * (z**2)[:, None, None])
    tangents[:, 0, 0] += z / intrinsics[0]
    tangents[:, 1, 1] += z / intrinsics[1]
    along_ray = rays * (z**2)[:, None]
    covariance = tangents @ uv_covariance @ tangents.transpose(0, 2, 1)
    covariance += variances[:, None, None] * (along_ray[:, :, None] * along_ray[:, None, :])
    return p_CF, 0.5 * (covariance + covariance.transpose(0, 2, 1)), tangents


def patch_warps(p_CF: Array, tangents: Array, intrinsics: Array) -> Array:
    """Affine maps (N, 2, 2) from a patch seen earlier to the present image.

    The surface with `tangents` (N, 3, 2), seen when the patch was taken, has moved to `p_CF`
    (N, 3) without turning; the chain rule with the projection's Jacobian gives the map.
    """
    z = p_CF[:, 2]
    jacobian = np.zeros((len(p_CF), 2, 3))
    jacobian[:, 0, 0] = intrinsics[0] / z
    jacobian[:, 1, 1] = intrinsics[1] / z
    jacobian[:, 0, 2] = -intrinsics[0] * p_CF[:, 0] / z**2
    jacobian[:, 1, 2] = -intrinsics[1] * p_CF[:, 1] / z**2
    return jacobian @ tangents


def incidence_cosines(p_CF: Array, tangents: Array) -> Array:
    """Cosine (N,) between the ray to each point and its surface's normal."""
    normals = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    along = np.abs(np.sum(normals * p_CF, axis=1))
    lengths = np.linalg.norm(normals, axis=1) * np.linalg.norm(p_CF, axis=1)
    return np.asarray(along / np.maximum(lengths, 1e-300))


def displaced(
    mask: npt.NDArray[np.uint8], depth: npt.NDArray[np.float32], X_SC: Array, intrinsics: Array
) -> npt.NDArray[np.uint8]:
    """A mask (H, W) in the image of a camera S, moved to where the camera C next to it sees it.

    Exact for a turn; a shift counts as it does at the median depth of what is masked.

    Args:
        mask: Nonzero on something.
        depth: (H, W) of C, [m]; 0, NaN or inf is no return.
        X_SC: Pose of C in S (4, 4).
        intrinsics: (fx, fy, cx, cy) of both, [px].
    """
    masked = depth[(mask > 0) & np.isfinite(depth) & (depth > 0.0)]
    if np.array_equal(X_SC, np.eye(4)) or len(masked) == 0:
        return mask
    fx, fy, cx, cy = intrinsics
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    X_CS = np.linalg.inv(X_SC)
    plane = np.outer(X_CS[:3, 3], [0.0, 0.0, 1.0 / float(np.median(masked))])
    H = K @ (X_CS[:3, :3] + plane) @ np.linalg.inv(K)
    moved = cv2.warpPerspective(mask, H, mask.shape[::-1], flags=cv2.INTER_NEAREST)
    return np.asarray(moved, dtype=np.uint8)
