"""Normalised patches of an image, compiled: how they are cut, sampled and compared.

A template is normalised to zero mean and unit norm, and so is the image under it; their inner
product is the zero-mean normalised cross-correlation (ZNCC).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot

Image = npt.NDArray[np.float32]


@dataclass(kw_only=True)
class Templates:
    """N normalised patches of P x P pixels, n = P^2.

    Attributes:
        values: (N, n), zero mean and unit norm.
        gradients: Of the normalised values (N, 2, n), [1/px].
        overlaps: Inner products (N, 6) of the values with their six derivatives, with respect to
            shift (gx, gy) and affine map (gx x, gx y, gy x, gy y).
        hessians: (N, 6, 6) inner products of the derivatives, less what a change of offset or gain
            explains.
        contrast: Standard deviation of the patch (N,), [grey levels].
    """

    values: Image
    gradients: Image
    overlaps: Array
    hessians: Array
    contrast: Array

    def select(self, index: Ids | Mask) -> "Templates":
        return Templates(
            values=self.values[index],
            gradients=self.gradients[index],
            overlaps=self.overlaps[index],
            hessians=self.hessians[index],
            contrast=self.contrast[index],
        )


def concatenate(first: Templates, second: Templates) -> Templates:
    return Templates(
        values=np.concatenate([first.values, second.values]),
        gradients=np.concatenate([first.gradients, second.gradients]),
        overlaps=np.concatenate([first.overlaps, second.overlaps]),
        hessians=np.concatenate([first.hessians, second.hessians]),
        contrast=np.concatenate([first.contrast, second.contrast]),
    )


@hot
def sample(image: Image, u: float, v: float, A: Array, radius: int, out: Image) -> bool:
    """Bilinear patch around (u, v) under the map A; False if it leaves the image."""
    height, width = image.shape
    reach_u = radius * (abs(A[0, 0]) + abs(A[0, 1])) + 1.0
    reach_v = radius * (abs(A[1, 0]) + abs(A[1, 1])) + 1.0
    if not (reach_u < u < width - 1 - reach_u and reach_v < v < height - 1 - reach_v):
        return False
    k = 0
    for y in range(-radius, radius + 1):
        for x in range(-radius, radius + 1):
            pu = u + A[0, 0] * x + A[0, 1] * y
            pv = v + A[1, 0] * x + A[1, 1] * y
            iu, iv = int(pu), int(pv)
            fu, fv = np.float32(pu - iu), np.float32(pv - iv)
            top = image[iv, iu] + fu * (image[iv, iu + 1] - image[iv, iu])
            bottom = image[iv + 1, iu] + fu * (image[iv + 1, iu + 1] - image[iv + 1, iu])
            out[k] = top + fv * (bottom - top)
            k += 1
    return True


@hot
def correlation(patch: Image, template: Image) -> float:
    """Inner product, in lanes: a compiler must not reorder sums, and one chain of them is slow."""
    n = patch.shape[0]
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = np.float32(0.0)
    for k in range(0, n - 7, 8):
        s0 += patch[k] * template[k]
        s1 += patch[k + 1] * template[k + 1]
        s2 += patch[k + 2] * template[k + 2]
        s3 += patch[k + 3] * template[k + 3]
        s4 += patch[k + 4] * template[k + 4]
        s5 += patch[k + 5] * template[k + 5]
        s6 += patch[k + 6] * template[k + 6]
        s7 += patch[k + 7] * template[k + 7]
    for k in range(n - n % 8, n):
        s0 += patch[k] * template[k]
    return float(((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)))


@hot
def normalise(patch: Image) -> float:
    """Removes the mean and scales to unit norm in place; returns the standard deviation."""
    n = patch.shape[0]
    s0 = s1 = s2 = s3 = np.float32(0.0)
    for k in range(0, n - 3, 4):
        s0 += patch[k]
        s1 += patch[k + 1]
        s2 += patch[k + 2]
        s3 += patch[k + 3]
    for k in range(n - n % 4, n):
        s0 += patch[k]
    mean = ((s0 + s1) + (s2 + s3)) / np.float32(n)
    for k in range(n):
        patch[k] -= mean
    norm = np.sqrt(np.float32(correlation(patch, patch)))
    if norm > 0.0:
        share = np.float32(1.0) / norm
        for k in range(n):
            patch[k] *= share
    return float(norm) / np.sqrt(n)


@hot
def derivatives(gradients: Image, radius: int, values: Image) -> Array:
    """Inner products (6,) of `values` (n,) with the derivatives to shift and affine map."""
    products = np.zeros(6)
    k = 0
    for y in range(-radius, radius + 1):
        for x in range(-radius, radius + 1):
            a, b = gradients[0, k] * values[k], gradients[1, k] * values[k]
            products[0] += a
            products[1] += b
            products[2] += a * x
            products[3] += a * y
            products[4] += b * x
            products[5] += b * y
            k += 1
    return products


@hot
def _hessian(gradients: Image, radius: int, overlaps: Array) -> Array:
    n = gradients.shape[1]
    hessian = np.zeros((6, 6))
    mean = np.zeros(6)
    row = np.zeros(6)
    k = 0
    for y in range(-radius, radius + 1):
        for x in range(-radius, radius + 1):
            gx, gy = gradients[0, k], gradients[1, k]
            row[0], row[1], row[2], row[3], row[4], row[5] = gx, gy, gx * x, gx * y, gy * x, gy * y
            for a in range(6):
                mean[a] += row[a]
                for b in range(6):
                    hessian[a, b] += row[a] * row[b]
            k += 1
    for a in range(6):
        for b in range(6):
            hessian[a, b] -= mean[a] * mean[b] / n + overlaps[a] * overlaps[b]
    return hessian


@hot
def _cut(image: Image, uv: Array, radius: int) -> tuple[Image, Image, Array, Array, Array, Mask]:
    count, side = uv.shape[0], 2 * radius + 1
    n = side * side
    values = np.zeros((count, n), dtype=np.float32)
    gradients = np.zeros((count, 2, n), dtype=np.float32)
    overlaps = np.zeros((count, 6))
    hessians = np.zeros((count, 6, 6))
    contrast = np.zeros(count)
    valid = np.zeros(count, dtype=np.bool_)
    shifted = np.empty(n, dtype=np.float32)
    identity = np.eye(2)
    for i in range(count):
        u, v = uv[i]
        inside = True
        for axis in range(2):
            du, dv = (1.0, 0.0) if axis == 0 else (0.0, 1.0)
            inside &= sample(image, u + du, v + dv, identity, radius, shifted)
            gradients[i, axis] = np.float32(0.5) * shifted
            inside &= sample(image, u - du, v - dv, identity, radius, shifted)
            gradients[i, axis] -= np.float32(0.5) * shifted
        inside &= sample(image, u, v, identity, radius, values[i])
        contrast[i] = normalise(values[i])
        if not inside or contrast[i] <= 0.0:
            continue
        gradients[i] /= np.float32(contrast[i] * np.sqrt(n))
        overlaps[i] = derivatives(gradients[i], radius, values[i])
        hessians[i] = _hessian(gradients[i], radius, overlaps[i])
        H = hessians[i]
        valid[i] = H[0, 0] * H[1, 1] - H[0, 1] ** 2 > 1e-12
    return values, gradients, overlaps, hessians, contrast, valid


def cut_templates(image: Image, uv: Array, radius: int) -> tuple[Templates, Mask]:
    """Templates of the patches around `uv` (N, 2), and whether each is usable (N,)."""
    values, gradients, overlaps, hessians, contrast, valid = _cut(image, uv, radius)
    templates = Templates(
        values=values,
        gradients=gradients,
        overlaps=overlaps,
        hessians=hessians,
        contrast=contrast,
    )
    return templates, valid


@hot
def _score(image: Image, values: Image, warps: Array, uv: Array, radius: int) -> Array:
    scores = np.full(uv.shape[0], -1.0)
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(uv.shape[0]):
        if sample(image, uv[i, 0], uv[i, 1], warps[i], radius, patch):
            normalise(patch)
            scores[i] = correlation(patch, values[i])
    return scores


def score_patches(image: Image, templates: Templates, warps: Array, uv: Array) -> Array:
    """ZNCC (N,) of each template with the image at `uv` (N, 2); -1 outside the image."""
    return _score(image, templates.values, warps, uv, radius_of(templates))


@hot
def _contrasts(image: Image, warps: Array, uv: Array, radius: int) -> Array:
    contrasts = np.zeros(uv.shape[0])
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(uv.shape[0]):
        if sample(image, uv[i, 0], uv[i, 1], warps[i], radius, patch):
            contrasts[i] = normalise(patch)
    return contrasts


def patch_contrasts(image: Image, templates: Templates, warps: Array, uv: Array) -> Array:
    """Standard deviation (N,) of the image under each patch, [grey levels]; 0 outside it."""
    return _contrasts(image, np.ascontiguousarray(warps), uv, radius_of(templates))


def radius_of(templates: Templates) -> int:
    return (round(np.sqrt(templates.values.shape[1])) - 1) // 2
