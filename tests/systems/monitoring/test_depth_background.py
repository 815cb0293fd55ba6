"""When the depth of what stands still has changed, and when only something has moved."""

import numpy as np
import pytest

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.depth_background import (
    DepthBackground,
    DepthBackgroundConfig,
    watch_depth,
)

CONFIG = DepthBackgroundConfig()
HEIGHT, WIDTH = 240, 320


def measured(tick: int, offset: float = 0.0, moved: float = 0.0, share: float = 0.0) -> Array:
    """Depth (H, W, 1) of a slope with a camera's noise; a share of it has come nearer."""
    rng = np.random.default_rng(tick)
    depth = np.tile(np.linspace(0.7, 2.0, WIDTH), (HEIGHT, 1))
    depth[: round(share * HEIGHT)] -= moved
    noise = 1.2e-3 + 1.9e-3 * (depth - 0.4) ** 2
    depth = depth + offset + noise * rng.standard_normal(depth.shape)
    depth[rng.random(depth.shape) < 0.05] = 0.0
    return depth[:, :, None].astype(np.float32)


def told(images: list[Array], robots: list[Array | None] | None = None) -> list[bool]:
    """Per image, whether the sensor has changed."""
    background: DepthBackground | None = None
    found = []
    for image, robot in zip(images, robots or [None] * len(images), strict=True):
        background, has_changed = watch_depth(CONFIG, background, image, robot)
        found.append(has_changed)
    return found


def test_noise_is_no_change() -> None:
    assert not any(told([measured(k) for k in range(50)]))


def test_a_drift_is_told_after_some_millimetres_and_no_longer_than_it_lasts() -> None:
    offsets = [0.0] * 10 + [3e-4 * k for k in range(1, 40)] + [0.0] * 10
    found = told([measured(k, offset) for k, offset in enumerate(offsets)])
    first = offsets[found.index(True)]
    assert 0.5e-3 < first < 3e-3
    assert all(found[found.index(True) + 3 : 49])
    assert not any(found[49:])


def test_a_step_to_either_side_is_told_at_once() -> None:
    for step in (0.05, -0.05):
        assert told([measured(0), measured(1, step), measured(2)]) == [False, True, False]


def test_an_object_that_fills_half_of_the_image_may_move() -> None:
    images = [measured(k, moved=2e-3 * k, share=0.5) for k in range(100)]
    assert not any(told(images))


def door(tick: int, angle: float, share: float) -> Array:
    """Depth (H, W, 1) of a door beside a wall, in a share of the image's width, with noise.

    It turns about the image's left edge, 1.5 m away and across the line of sight.
    """
    width = round(share * WIDTH)
    slope = np.linspace(-0.6, 0.6, WIDTH)[:width]  # x / z
    hinge = -0.6 * 1.5
    depth = np.full((HEIGHT, WIDTH), 1.5)
    tan = np.tan(0.2 + angle)  # z = 1.5 - tan (x - hinge)
    depth[:, :width] = (1.5 + tan * hinge) / (1.0 + tan * slope)
    rng = np.random.default_rng(tick)
    noise = 1.2e-3 + 1.9e-3 * (depth - 0.4) ** 2
    return (depth + noise * rng.standard_normal(depth.shape))[:, :, None].astype(np.float32)


@pytest.mark.parametrize("share", [0.6, 0.7, 0.8, 0.9, 1.0])
def test_a_door_that_fills_most_of_the_image_may_turn(share: float) -> None:
    angles = np.concatenate([np.zeros(10), 2e-3 * np.arange(200)])
    assert not any(told([door(k, angle, share) for k, angle in enumerate(angles)]))


def test_what_shows_something_else_than_at_first_in_most_of_the_image_is_no_change() -> None:
    """All of it farther away, as behind a door, but each place by another amount."""
    farther = np.kron(np.random.default_rng(1).uniform(0.0, 0.2, (6, 8)), np.ones((40, 40)))
    farther[:48] = 0.0
    images = [measured(k) for k in range(3)]
    images += [measured(k) + farther[:, :, None].astype(np.float32) for k in range(3, 20)]
    assert not any(told(images))


def test_the_robot_counts_for_nothing() -> None:
    share = 5.0 / 6.0  # Whole rows of blocks.
    robot = np.zeros((HEIGHT, WIDTH, 1), np.uint8)
    robot[: round(share * HEIGHT)] = 255
    images = [measured(k, moved=0.01 * max(k - 10, 0), share=share) for k in range(30)]
    assert any(told(images))
    assert not any(told(images, [robot] * 30))


def test_a_covered_camera_and_a_small_image_tell_nothing() -> None:
    covered = np.zeros((HEIGHT, WIDTH, 1), np.float32)
    assert told([measured(0), covered, measured(2)]) == [False, False, False]
    assert told([np.full((3, 4, 1), depth, np.float32) for depth in (1.0, 2.0)]) == [False, False]


def test_depth_that_is_no_number_is_no_return() -> None:
    holed = measured(1)
    holed[::2] = np.nan
    holed[1::4] = np.inf
    assert told([measured(0), holed, measured(2)]) == [False, False, False]
