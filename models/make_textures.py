"""Makes the object textures from a seed: `python -m crossmodal.models.make_textures`.

Each is a tileable pattern with detail at many scales, as on veneered or printed fronts, so that
corners are found at any distance; those called plain are paint, on which there are none.
"""

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR

Image = Array
SIZE = 512  # Width and height, [pixels].

# Dark and light colours (RGB, 0 to 1), stretch along the grain, and printed marks per texture.
PALETTES: dict[str, tuple[tuple[float, ...], tuple[float, ...], float, int]] = {
    "oak": ((0.45, 0.29, 0.15), (0.84, 0.66, 0.43), 8.0, 90),
    "walnut": ((0.19, 0.11, 0.07), (0.52, 0.34, 0.22), 6.0, 120),
    "birch": ((0.62, 0.50, 0.36), (0.94, 0.86, 0.72), 10.0, 110),
    "teal_print": ((0.05, 0.30, 0.33), (0.55, 0.80, 0.78), 1.0, 160),
    "terrazzo": ((0.35, 0.33, 0.32), (0.85, 0.83, 0.80), 1.0, 260),
    "carton": ((0.55, 0.41, 0.26), (0.80, 0.65, 0.46), 5.0, 70),
    "carton_print": ((0.42, 0.22, 0.12), (0.84, 0.70, 0.52), 1.5, 110),
    # Paint: the same everywhere.
    "plain_white": ((0.86, 0.85, 0.82), (0.86, 0.85, 0.82), 1.0, 0),
    "plain_grey": ((0.55, 0.56, 0.58), (0.55, 0.56, 0.58), 1.0, 0),
    "plain_sand": ((0.74, 0.66, 0.52), (0.74, 0.66, 0.52), 1.0, 0),
    "plain_blue": ((0.24, 0.33, 0.45), (0.24, 0.33, 0.45), 1.0, 0),
    "plain_black": ((0.09, 0.09, 0.10), (0.09, 0.09, 0.10), 1.0, 0),
}


def smooth_noise(rng: np.random.Generator, cells_x: int, cells_y: int) -> Image:
    """Periodic noise (SIZE, SIZE) in [0, 1] with the given number of cells each way."""
    grid = np.tile(rng.random((cells_y, cells_x)), (3, 3))
    field = cv2.resize(grid, (3 * SIZE, 3 * SIZE), interpolation=cv2.INTER_CUBIC)
    return np.clip(field[SIZE : 2 * SIZE, SIZE : 2 * SIZE], 0.0, 1.0)


def make_texture(
    rng: np.random.Generator,
    dark: tuple[float, ...],
    light: tuple[float, ...],
    stretch: float,
    marks: int,
) -> npt.NDArray[np.uint8]:
    """One RGB texture (SIZE, SIZE, 3): fractal noise along a grain, with knots or chips on it."""
    grain = np.zeros((SIZE, SIZE))
    for octave in range(5):
        cells = 4 * 2**octave
        grain += 0.6**octave * smooth_noise(rng, max(2, round(cells / stretch)), cells)
    grain = (grain - grain.min()) / np.ptp(grain)
    image = np.asarray(dark) + grain[..., None] * (np.asarray(light) - np.asarray(dark))
    for _ in range(marks):
        centre = rng.integers(0, SIZE, 2)
        axes = rng.integers(2, 11, 2)
        axes[0] = round(axes[0] * min(stretch, 2.5))
        shade = (
            np.asarray(dark) * rng.uniform(0.3, 0.9) if rng.random() < 0.6 else np.asarray(light)
        )
        angle = rng.uniform(0, 180) if stretch == 1.0 else rng.uniform(-8, 8)
        cv2.ellipse(
            image,
            tuple(map(int, centre)),
            tuple(map(int, axes)),
            float(angle),
            0,
            360,
            shade.tolist(),
            -1,
            cv2.LINE_AA,
        )
    return (np.clip(image, 0.0, 1.0) * 255).astype(np.uint8)


def main() -> None:
    rng = np.random.default_rng(2016)
    folder = SDF_DIR / "textures"
    folder.mkdir(exist_ok=True)
    for name, (dark, light, stretch, marks) in PALETTES.items():
        texture = make_texture(rng, dark, light, stretch, marks)
        cv2.imwrite(str(folder / f"{name}.png"), texture[..., ::-1])


if __name__ == "__main__":
    main()
