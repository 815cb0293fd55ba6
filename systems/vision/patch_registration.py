"""Registration of small patches of an image against templates, blind to gain and offset, compiled.

A template is normalised to zero mean and unit norm, and so is the image under it; their inner
product is the zero-mean normalised cross-correlation (ZNCC). Gauss-Newton steps with the template's
own gradients (inverse compositional) move the patch; a known affine map A per patch accounts for
the change of scale and foreshortening since the template was taken.

Source: S. Baker and I. Matthews, Lucas-Kanade 20 Years On: A Unifying Framework, 2004, section 3.2.
"""

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


@dataclass(kw_only=True)
class Templates:
    """N normalised patches of P x P pixels, n = P^2.

    Attributes:
        values: (N, n), zero mean and unit norm.
        gradients: (N, 2, n), of the normalised values per pixel, without the parts that a change
            of offset or gain explains.
        inverse_hessians: (N, 2, 2) of gradients @ gradients.T.
        contrast: Standard deviation of the patch (N,), [grey levels].
    """

    values: Image
    gradients: Image
    inverse_hessians: Array
    contrast: Array

    def select(self, index: npt.NDArray[np.int64] | Mask) -> "Templates":
        return Templates(
            values=self.values[index],
            gradients=self.gradients[index],
            inverse_hessians=self.inverse_hessians[index],
            contrast=self.contrast[index],
        )


def concatenate(first: Templates, second: Templates) -> Templates:
    return Templates(
        values=np.concatenate([first.values, second.values]),
        gradients=np.concatenate([first.gradients, second.gradients]),
        inverse_hessians=np.concatenate([first.inverse_hessians, second.inverse_hessians]),
        contrast=np.concatenate([first.contrast, second.contrast]),
    )


@numba.njit(cache=True, fastmath=True)
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


@numba.njit(cache=True, fastmath=True)
def _normalise(patch: Image) -> float:
    """Removes the mean and scales to unit norm in place; returns the standard deviation."""
    n = patch.shape[0]
    mean = np.float32(0.0)
    for k in range(n):
        mean += patch[k]
    mean /= n
    square = np.float32(0.0)
    for k in range(n):
        patch[k] -= mean
        square += patch[k] * patch[k]
    norm = np.sqrt(square)
    if norm > 0.0:
        for k in range(n):
            patch[k] /= norm
    return float(norm) / np.sqrt(n)


@numba.njit(cache=True)
def _correlation(patch: Image, template: Image) -> float:
    total = np.float32(0.0)
    for k in range(patch.shape[0]):
        total += patch[k] * template[k]
    return float(total)


@numba.njit(cache=True)
def _cut(
    image: Image, uv: Array, radius: int
) -> tuple[Image, Image, Array, Array, npt.NDArray[np.bool_]]:
    count, side = uv.shape[0], 2 * radius + 1
    n = side * side
    values = np.zeros((count, n), dtype=np.float32)
    gradients = np.zeros((count, 2, n), dtype=np.float32)
    inverse_hessians = np.zeros((count, 2, 2))
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
        for axis in range(2):
            gradients[i, axis] -= gradients[i, axis].mean()
            gradients[i, axis] -= _correlation(gradients[i, axis], values[i]) * values[i]
        hessian = np.zeros((2, 2))
        for a in range(2):
            for b in range(2):
                hessian[a, b] = _correlation(gradients[i, a], gradients[i, b])
        determinant = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] ** 2
        if determinant <= 1e-12:
            continue
        inverse_hessians[i] = np.linalg.inv(hessian)
        valid[i] = True
    return values, gradients, inverse_hessians, contrast, valid


def cut_templates(image: Image, uv: Array, radius: int) -> tuple[Templates, Mask]:
    """Templates of the patches around `uv` (N, 2), and whether each is usable (N,)."""
    values, gradients, inverse_hessians, contrast, valid = _cut(image, uv, radius)
    templates = Templates(
        values=values,
        gradients=gradients,
        inverse_hessians=inverse_hessians,
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
def _register(
    image: Image,
    values: Image,
    gradients: Image,
    inverse_hessians: Array,
    warps: Array,
    uv: Array,
    radius: int,
    iterations: int,
    reach: float,
) -> tuple[Array, Array]:
    count = uv.shape[0]
    result = uv.copy()
    scores = np.full(count, -1.0)
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(count):
        u, v = uv[i]
        for _ in range(iterations):
            if not _sample(image, u, v, warps[i], radius, patch):
                break
            _normalise(patch)
            score = _correlation(patch, values[i])
            if score > scores[i]:
                scores[i] = score
                result[i, 0], result[i, 1] = u, v
            # With <template, gradient> = 0 the residual's projection is that of the patch alone.
            g0 = _correlation(patch, gradients[i, 0]) / max(score, 0.3)
            g1 = _correlation(patch, gradients[i, 1]) / max(score, 0.3)
            s0 = -(inverse_hessians[i, 0, 0] * g0 + inverse_hessians[i, 0, 1] * g1)
            s1 = -(inverse_hessians[i, 1, 0] * g0 + inverse_hessians[i, 1, 1] * g1)
            length = np.sqrt(s0 * s0 + s1 * s1)
            if length > 2.0:
                s0, s1 = 2.0 * s0 / length, 2.0 * s1 / length
            u += warps[i, 0, 0] * s0 + warps[i, 0, 1] * s1
            v += warps[i, 1, 0] * s0 + warps[i, 1, 1] * s1
            if abs(u - uv[i, 0]) > reach or abs(v - uv[i, 1]) > reach or length < 0.005:
                break
    return result, scores


def register_patches(
    image: Image,
    templates: Templates,
    warps: Array,
    uv: Array,
    *,
    iterations: int = 10,
    reach: float = 8.0,
) -> tuple[Array, Array]:
    """Moves each template from its start `uv` (N, 2) to where it fits the image best.

    Args:
        warps: Affine maps (N, 2, 2) from template to image.
        reach: Largest distance from the start, [px].

    Returns:
        Pixels (N, 2) and ZNCC (N,), -1 where the patch leaves the image.
    """
    return _register(
        image,
        templates.values,
        templates.gradients,
        templates.inverse_hessians,
        warps,
        np.ascontiguousarray(uv, dtype=np.float64),
        _radius(templates),
        iterations,
        reach,
    )


def registration_covariance(
    templates: Templates, warps: Array, scores: Array, correlated_pixels: float, floor: float
) -> Array:
    """Covariance (N, 2, 2) of registered pixels, [px^2].

    The residual of two unit vectors has the squared norm 2 - 2 ZNCC; its mean over the pixels,
    times the number of pixels whose noise is one, scales the inverse Hessian.
    """
    n = templates.values.shape[1]
    variance = correlated_pixels * (2.0 - 2.0 * np.clip(scores, 0.0, 1.0)) / (n - 4)
    covariance = warps @ (variance[:, None, None] * templates.inverse_hessians)
    covariance = covariance @ warps.transpose(0, 2, 1)
    return covariance + floor**2 * np.eye(2)


def _radius(templates: Templates) -> int:
    return (round(np.sqrt(templates.values.shape[1])) - 1) // 2
