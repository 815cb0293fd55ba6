"""Where tracks of new features begin: corners that stand out of the noise, spread evenly."""

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Ids

Image = npt.NDArray[np.float32]
Byte = npt.NDArray[np.uint8]

_BLUR = np.outer(*[cv2.getGaussianKernel(5, 1.0)[:, 0]] * 2)
_BLOCK = 5  # Width of the window that a structure tensor is averaged over, [px].
_NOISE_WINDOW = 9  # Of what a blurred image's structure tensor depends on, [px].
_LEVEL_WIDTH = 16  # Of a class of grey levels that have the same noise.
# Least ratio of a structure tensor's eigenvalues: pixels break a slanted edge into steps, which
# look like corners and run along the edge when it moves. The ratio is that of D. Lowe, Distinctive
# Image Features from Scale-Invariant Keypoints, 2004, section 4.1.
_EDGE_RATIO = 0.1


def _gradient_gain() -> float:
    """Variance of a Sobel derivative of the blurred image, per variance of a raw pixel's noise."""
    sobel = np.array([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]]) / 8.0
    padded = np.zeros((9, 9))
    padded[2:7, 2:7] = _BLUR
    response = cv2.filter2D(padded, cv2.CV_64F, sobel)
    return float(np.sum(response**2))


_GRADIENT_GAIN = _gradient_gain()
BLUR_GAIN = float(np.sqrt(np.sum(_BLUR**2)))  # Standard deviation of noise left by the blur.


def smooth_grey(rgba: Byte) -> tuple[Image, Image]:
    """The grey image (H, W), slightly blurred, and the standard deviation of the raw noise (H, W).

    A camera's noise depends on how bright a pixel is; where the image is dark, it is often several
    times as large. What is returned for a pixel is the mean around it, so that a patch on an edge
    between dark and bright counts as half of each.
    """
    grey = cv2.cvtColor(rgba, cv2.COLOR_RGBA2GRAY)
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (5, 5), 1.0)
    variance = cv2.LUT(smooth.astype(np.uint8), (_noise_of_levels(grey) ** 2).astype(np.float32))
    return smooth, np.sqrt(cv2.blur(variance, (_NOISE_WINDOW, _NOISE_WINDOW)))


def _noise_of_levels(grey: Byte) -> Array:
    """Standard deviation (256,) of the raw noise at each grey level; zero where nothing tells.

    It is read from the flattest quarter of the pixels of about that level: the lower quartile of
    the response of a mask that is blind to planes, which for white noise is 0.3186 standard
    deviations.

    Source: J. Immerkaer, Fast Noise Variance Estimation, 1996 (the mask; quartile and levels are
    ours).
    """
    rows = grey[::4].astype(np.int16)
    above, below = grey[1::4].astype(np.int16), grey[2::4].astype(np.int16)
    count = min(len(rows), len(above), len(below))
    rows, above, below = rows[:count], above[:count], below[:count]
    second = [image[:, :-2] - 2 * image[:, 1:-1] + image[:, 2:] for image in (rows, above, below)]
    response = np.minimum(np.abs(second[0] - 2 * second[1] + second[2]), 255)[:, ::2]
    level = ((rows + 2 * above + below)[:, 1:-1:2]) // (4 * _LEVEL_WIDTH)
    unsaturated = ((above > 0) & (above < 255))[:, 1:-1:2]
    counts = np.bincount(
        256 * level[unsaturated].astype(np.int64) + response[unsaturated],
        minlength=256 * (256 // _LEVEL_WIDTH),
    ).reshape(-1, 256)
    known = np.nonzero(counts.sum(axis=1) > 100)[0]
    if len(known) == 0:
        return np.zeros(256)
    shares = np.cumsum(counts[known], axis=1) / counts[known].sum(axis=1, keepdims=True)
    quartiles = [np.interp(0.25, share, np.arange(256) + 0.5) for share in shares]
    centres = _LEVEL_WIDTH * (known + 0.5)
    return np.interp(np.arange(256), centres, quartiles) / (0.3186 * 6.0)


def flat_depth_mask(depth: Image, radius: int, step: float) -> Byte:
    """255 where every pixel within `radius` has a return and no neighbour jumps by `step` [m]."""
    valid = np.isfinite(depth) & (depth > 0.0)
    z = np.where(valid, depth, 0.0).astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    smooth = cv2.blur(z, (3, 3))
    edge = cv2.dilate(smooth, kernel) - cv2.erode(smooth, kernel) > np.float32(step)
    bad = (edge | ~valid).astype(np.uint8)
    bad = cv2.dilate(bad, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return (255 * (1 - bad)).astype(np.uint8)


def find_corners(
    image: Image,
    allowed: Byte,
    existing_uv: Array,
    count: int,
    *,
    noise: Image,
    min_distance: int,
    noise_factor: float,
    cells: tuple[int, int] = (8, 6),
) -> Array:
    """Up to `count` corners (K, 2) at integer pixels, strong against noise, spread over the image.

    Edges are not corners, however strong they are.

    Args:
        image: Blurred grey image (H, W).
        allowed: Nonzero where a corner may lie (H, W).
        existing_uv: Features that exist (N, 2); corners keep `min_distance` from them.
        count: Number wanted.
        noise: Standard deviation of the raw image's noise (H, W), [grey levels].
        min_distance: Between features, [px].
        noise_factor: Least ratio of a corner's smaller structure tensor eigenvalue to the noise's.
        cells: The image is divided into so many (columns, rows), which are filled evenly.
    """
    allowed = allowed.copy()
    for u, v in existing_uv:
        if np.isfinite(u) and np.isfinite(v):
            cv2.circle(allowed, (round(u), round(v)), min_distance, 0, -1)
    strength = cv2.cornerMinEigenVal(image, _BLOCK, ksize=3)
    strength *= 0.25  # OpenCV's derivatives of float images are twice those per pixel.
    threshold = noise_factor * _GRADIENT_GAIN * np.maximum(noise, 0.5) ** 2
    side = 2 * (min_distance // 2) + 1
    peak = strength >= cv2.dilate(strength, np.ones((side, side), np.uint8))
    is_corner = cv2.cornerHarris(image, _BLOCK, 3, _EDGE_RATIO / (1.0 + _EDGE_RATIO) ** 2) > 0.0
    rows, columns = np.nonzero(peak & (allowed > 0) & is_corner & (strength > threshold))
    order = np.argsort(-strength[rows, columns], kind="stable")[: 8 * max(count, 1)]
    corners = np.stack([columns[order], rows[order]], axis=1).astype(float)
    height, width = image.shape
    shape = np.array([width / cells[0], height / cells[1]])
    return _spread(corners, existing_uv, count, min_distance, shape, cells)


def _spread(
    corners: Array,
    existing_uv: Array,
    count: int,
    min_distance: int,
    cell_shape: Array,
    cells: tuple[int, int],
) -> Array:
    """Takes corners, best first, from the cells with the fewest features."""

    def cell_of(uv: Array) -> Ids:
        index = np.clip((uv / cell_shape).astype(np.int64), 0, np.array(cells) - 1)
        return np.asarray(index[:, 1] * cells[0] + index[:, 0])

    known = existing_uv[np.all(np.isfinite(existing_uv), axis=1)]
    crowd = np.bincount(cell_of(known), minlength=cells[0] * cells[1])
    cell = cell_of(corners)
    rank = np.zeros(len(corners))
    for c in np.unique(cell):
        members = np.nonzero(cell == c)[0]
        rank[members] = crowd[c] + np.arange(len(members))
    chosen = np.empty((0, 2))
    for i in np.lexsort((np.arange(len(corners)), rank)):
        if len(chosen) == count:
            break
        if np.all(np.abs(corners[i] - chosen).max(axis=1, initial=0.0) >= min_distance):
            chosen = np.vstack([chosen, corners[i]])
    return chosen
