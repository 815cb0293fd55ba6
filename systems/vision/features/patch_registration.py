"""Registration of small patches of an image against templates, blind to gain and offset, compiled.

A template is normalised to zero mean and unit norm, and so is the image under it; their inner
product is the zero-mean normalised cross-correlation (ZNCC). Gauss-Newton steps with the template's
own gradients (inverse compositional) move the patch, x in the template to u + A x in the image. The
affine map A starts from what is known of scale and foreshortening, and may change a little.

Source: S. Baker and I. Matthews, Lucas-Kanade 20 Years On: A Unifying Framework, 2004, section 3.2.
"""

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from maths.arrays import Array, Ids, Mask

Image = npt.NDArray[np.float32]
Mask = Mask


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


@numba.njit(cache=True)
def _sample(image: Image, u: float, v: float, A: Array, radius: int, out: Image) -> bool:
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


@numba.njit(cache=True)
def _correlation(patch: Image, template: Image) -> float:
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


@numba.njit(cache=True)
def _normalise(patch: Image) -> float:
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
    norm = np.sqrt(np.float32(_correlation(patch, patch)))
    if norm > 0.0:
        share = np.float32(1.0) / norm
        for k in range(n):
            patch[k] *= share
    return float(norm) / np.sqrt(n)


@numba.njit(cache=True)
def _derivatives(gradients: Image, radius: int, values: Image) -> Array:
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


@numba.njit(cache=True)
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


@numba.njit(cache=True)
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
            inside &= _sample(image, u + du, v + dv, identity, radius, shifted)
            gradients[i, axis] = np.float32(0.5) * shifted
            inside &= _sample(image, u - du, v - dv, identity, radius, shifted)
            gradients[i, axis] -= np.float32(0.5) * shifted
        inside &= _sample(image, u, v, identity, radius, values[i])
        contrast[i] = _normalise(values[i])
        if not inside or contrast[i] <= 0.0:
            continue
        gradients[i] /= np.float32(contrast[i] * np.sqrt(n))
        overlaps[i] = _derivatives(gradients[i], radius, values[i])
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


@numba.njit(cache=True)
def _score(image: Image, values: Image, warps: Array, uv: Array, radius: int) -> Array:
    scores = np.full(uv.shape[0], -1.0)
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(uv.shape[0]):
        if _sample(image, uv[i, 0], uv[i, 1], warps[i], radius, patch):
            _normalise(patch)
            scores[i] = _correlation(patch, values[i])
    return scores


def score_patches(image: Image, templates: Templates, warps: Array, uv: Array) -> Array:
    """ZNCC (N,) of each template with the image at `uv` (N, 2); -1 outside the image."""
    return _score(image, templates.values, warps, uv, _radius(templates))


@numba.njit(cache=True)
def _shift(
    image: Image,
    values: Image,
    gradients: Image,
    overlaps: Array,
    hessian: Array,
    A: Array,
    uv: Array,
    radius: int,
    iterations: int,
    reach: float,
    patch: Image,
) -> tuple[float, float, float]:
    """Gauss-Newton on the shift alone; the best pixel and its score."""
    u, v = uv
    best_u, best_v, best = u, v, -1.0
    determinant = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] ** 2
    for _ in range(iterations):
        if not _sample(image, u, v, A, radius, patch):
            break
        _normalise(patch)
        score = _correlation(patch, values)
        if score > best:
            best_u, best_v, best = u, v, score
        # The residual's part that a gain explains, score * overlap, does not move the patch.
        scale = 1.0 / (determinant * max(score, 0.3))
        g0 = (_correlation(patch, gradients[0]) - score * overlaps[0]) * scale
        g1 = (_correlation(patch, gradients[1]) - score * overlaps[1]) * scale
        s0 = hessian[0, 1] * g1 - hessian[1, 1] * g0
        s1 = hessian[0, 1] * g0 - hessian[0, 0] * g1
        length = np.sqrt(s0 * s0 + s1 * s1)
        if length > 2.0:
            s0, s1 = 2.0 * s0 / length, 2.0 * s1 / length
        u += A[0, 0] * s0 + A[0, 1] * s1
        v += A[1, 0] * s0 + A[1, 1] * s1
        if abs(u - uv[0]) > reach or abs(v - uv[1]) > reach or length < 0.005:
            break
    return best_u, best_v, best


@numba.njit(cache=True)
def _register(
    image: Image,
    values: Image,
    gradients: Image,
    overlaps: Array,
    hessians: Array,
    warps: Array,
    uv: Array,
    radius: int,
    iterations: int,
    reach: float,
    shape_sigma: Array,
) -> tuple[Array, Array, Array]:
    count = uv.shape[0]
    result = uv.copy()
    shapes = warps.copy()
    scores = np.full(count, -1.0)
    n = values.shape[1]
    patch = np.empty(n, dtype=np.float32)
    change = np.empty((2, 2))
    for i in range(count):
        u, v, score = _shift(
            image,
            values[i],
            gradients[i],
            overlaps[i],
            hessians[i],
            warps[i],
            uv[i],
            radius,
            iterations,
            reach,
            patch,
        )
        result[i, 0], result[i, 1], scores[i] = u, v, score
        if score < 0.6 or shape_sigma[i] <= 0.0:
            continue
        for _ in range(2):
            if not _sample(image, u, v, shapes[i], radius, patch):
                break
            _normalise(patch)
            now = _correlation(patch, values[i])
            normal = hessians[i] * now
            weight = max(2.0 - 2.0 * now, 1e-3) / n / shape_sigma[i] ** 2
            for a in range(2, 6):
                normal[a, a] += weight
            gradient = _derivatives(gradients[i], radius, patch) - now * overlaps[i]
            step = np.linalg.solve(normal, gradient)
            change[0, 0], change[0, 1] = 1.0 - step[2], -step[3]
            change[1, 0], change[1, 1] = -step[4], 1.0 - step[5]
            A = shapes[i] @ change
            shapes[i] = A
            u -= A[0, 0] * step[0] + A[0, 1] * step[1]
            v -= A[1, 0] * step[0] + A[1, 1] * step[1]
        if _sample(image, u, v, shapes[i], radius, patch):
            _normalise(patch)
            now = _correlation(patch, values[i])
            if now >= score and abs(u - result[i, 0]) + abs(v - result[i, 1]) < 2.0:
                result[i, 0], result[i, 1], scores[i] = u, v, now
            else:
                shapes[i] = warps[i]
        else:
            shapes[i] = warps[i]
    return result, scores, shapes


def register_patches(
    image: Image,
    templates: Templates,
    warps: Array,
    uv: Array,
    *,
    iterations: int = 10,
    reach: float = 8.0,
    shape_sigma: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Moves each template from its start `uv` (N, 2) to where it fits the image best.

    Args:
        image: (H, W).
        templates: N templates.
        warps: Affine maps (N, 2, 2) from template to image, to start from.
        uv: (N, 2).
        iterations: At most, of the shift.
        reach: Largest distance from the start, [px].
        shape_sigma: By how much the entries of each map may change (N,); zero keeps it, as does
            None.

    Returns:
        Pixels (N, 2), ZNCC (N,), -1 where the patch leaves the image, and maps (N, 2, 2).
    """
    fixed = np.zeros(len(uv))
    return _register(
        image,
        templates.values,
        templates.gradients,
        templates.overlaps,
        templates.hessians,
        np.ascontiguousarray(warps),
        np.ascontiguousarray(uv, dtype=np.float64),
        _radius(templates),
        iterations,
        reach,
        fixed if shape_sigma is None else shape_sigma,
    )


@numba.njit(cache=True)
def _contrasts(image: Image, warps: Array, uv: Array, radius: int) -> Array:
    contrasts = np.zeros(uv.shape[0])
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(uv.shape[0]):
        if _sample(image, uv[i, 0], uv[i, 1], warps[i], radius, patch):
            contrasts[i] = _normalise(patch)
    return contrasts


def patch_contrasts(image: Image, templates: Templates, warps: Array, uv: Array) -> Array:
    """Standard deviation (N,) of the image under each patch, [grey levels]; 0 outside it."""
    return _contrasts(image, np.ascontiguousarray(warps), uv, _radius(templates))


def registration_covariance(
    templates: Templates, warps: Array, scores: Array, correlated_pixels: float, floor: float
) -> Array:
    """Covariance (N, 2, 2) of registered pixels, [px^2].

    The residual of two unit vectors has the squared norm 2 - 2 ZNCC; its mean over the pixels,
    times the number of pixels whose noise is one, scales the inverse Hessian.
    """
    n = templates.values.shape[1]
    variance = correlated_pixels * (2.0 - 2.0 * np.clip(scores, 0.0, 1.0)) / (n - 4)
    inverse = np.linalg.inv(templates.hessians[:, :2, :2])
    covariance = warps @ (variance[:, None, None] * inverse) @ warps.transpose(0, 2, 1)
    return covariance + floor**2 * np.eye(2)


def _radius(templates: Templates) -> int:
    return (round(np.sqrt(templates.values.shape[1])) - 1) // 2
