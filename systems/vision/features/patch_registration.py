"""Registration of small patches of an image against templates, blind to gain and offset, compiled.

A template is normalised to zero mean and unit norm, and so is the image under it; their inner
product is the zero-mean normalised cross-correlation (ZNCC). Gauss-Newton steps with the template's
own gradients (inverse compositional) move the patch, x in the template to u + A x in the image. The
affine map A starts from what is known of scale and foreshortening, and may change a little.

Source: S. Baker and I. Matthews, Lucas-Kanade 20 Years On: A Unifying Framework, 2004, section 3.2.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.vision.features.patch_templates import (
    Image,
    Templates,
    correlation,
    derivatives,
    normalise,
    radius_of,
    sample,
)


@hot
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
        if not sample(image, u, v, A, radius, patch):
            break
        normalise(patch)
        score = correlation(patch, values)
        if score > best:
            best_u, best_v, best = u, v, score
        # The residual's part that a gain explains, score * overlap, does not move the patch.
        scale = 1.0 / (determinant * max(score, 0.3))
        g0 = (correlation(patch, gradients[0]) - score * overlaps[0]) * scale
        g1 = (correlation(patch, gradients[1]) - score * overlaps[1]) * scale
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


@hot
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
            if not sample(image, u, v, shapes[i], radius, patch):
                break
            normalise(patch)
            now = correlation(patch, values[i])
            normal = hessians[i] * now
            weight = max(2.0 - 2.0 * now, 1e-3) / n / shape_sigma[i] ** 2
            for a in range(2, 6):
                normal[a, a] += weight
            gradient = derivatives(gradients[i], radius, patch) - now * overlaps[i]
            step = np.linalg.solve(normal, gradient)
            change[0, 0], change[0, 1] = 1.0 - step[2], -step[3]
            change[1, 0], change[1, 1] = -step[4], 1.0 - step[5]
            A = shapes[i] @ change
            shapes[i] = A
            u -= A[0, 0] * step[0] + A[0, 1] * step[1]
            v -= A[1, 0] * step[0] + A[1, 1] * step[1]
        if sample(image, u, v, shapes[i], radius, patch):
            normalise(patch)
            now = correlation(patch, values[i])
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
        iterations: Most steps of the shift.
        reach: Largest distance from the start, [px].
        shape_sigma: Standard deviation (N,) of how much each map's entries change; zero keeps the
            map, as does None.

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
        radius_of(templates),
        iterations,
        reach,
        fixed if shape_sigma is None else shape_sigma,
    )


def registration_covariance(
    templates: Templates, warps: Array, scores: Array, correlated_pixels: float, floor: float
) -> Array:
    """Covariance (N, 2, 2) of registered pixels, [px^2].

    The residual of two unit vectors has the squared norm 2 - 2 ZNCC; its mean over the pixels,
    times the number of pixels with the same noise, scales the inverse Hessian.
    """
    n = templates.values.shape[1]
    variance = correlated_pixels * (2.0 - 2.0 * np.clip(scores, 0.0, 1.0)) / (n - 4)
    inverse = np.linalg.inv(templates.hessians[:, :2, :2])
    covariance = warps @ (variance[:, None, None] * inverse) @ warps.transpose(0, 2, 1)
    return covariance + floor**2 * np.eye(2)
