"""When a grey value has been added to what stands still, and when only the light has changed."""

import numpy as np
import pytest

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.background import Background
from crossmodal.systems.monitoring.black_level import BlackLevelConfig, law_of_grey, watch_grey

CONFIG = BlackLevelConfig()
HEIGHT, WIDTH = 240, 320


def measured(tick: int, offset: float = 0.0, gain: float = 1.0, covered: float = 0.0) -> Array:
    """Colours (H, W, 4) of a scene of many greys; a share of it is covered by another thing."""
    rng = np.random.default_rng(tick)
    scene = np.kron(np.random.default_rng(99).uniform(20.0, 170.0, (6, 8)), np.ones((40, 40)))
    other = np.kron(np.random.default_rng(98).uniform(20.0, 170.0, (24, 32)), np.ones((10, 10)))
    scene[: round(covered * HEIGHT)] = other[: round(covered * HEIGHT)]
    noisy = gain * scene[:, :, None] + 3.0 * rng.standard_normal((HEIGHT, WIDTH, 3)) + offset
    image = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    image[:, :, :3] = np.clip(np.rint(noisy), 0, 255)
    return image


def told(images: list[Array]) -> list[float]:
    """Offset per image."""
    background: Background | None = None
    found = []
    for image in images:
        background, offset = watch_grey(CONFIG, background, image, None)
        found.append(offset)
    return found


def test_noise_is_no_change() -> None:
    assert not any(told([measured(k) for k in range(30)]))


@pytest.mark.parametrize("offset", [40.0, 8.0, -15.0])
def test_an_offset_is_told_with_its_size_and_no_longer_than_it_lasts(offset: float) -> None:
    found = told([measured(0), measured(1, offset), measured(2)])
    assert found[0] == found[2] == 0.0
    assert found[1] == pytest.approx(offset, abs=1.0)


@pytest.mark.parametrize("gain", [0.4, 0.8, 1.3])
def test_another_exposure_is_no_fault(gain: float) -> None:
    assert not any(told([measured(0), *[measured(k, gain=gain) for k in range(1, 10)]]))


def test_an_offset_is_told_under_another_exposure() -> None:
    assert told([measured(0), measured(1, 20.0, 1.2)])[1] == pytest.approx(20.0, abs=1.5)


def test_what_is_uncovered_under_another_exposure_is_compared_at_the_first_one() -> None:
    images = [measured(0, covered=0.4), measured(1, gain=1.3), measured(2, gain=1.0)]
    images[0][: round(0.4 * HEIGHT), :, :3] = 0  # Black: nothing is known of it yet.
    assert not any(told([*images, *[measured(k) for k in range(3, 10)]]))


def test_something_that_moves_before_a_part_of_the_scene_is_no_fault() -> None:
    assert not any(told([measured(k, covered=0.05 * k) for k in range(10)]))


def test_darkness_and_a_small_image_tell_nothing() -> None:
    rng = np.random.default_rng(5)
    dark = measured(0)
    dark[:, :, :3] = rng.integers(0, 40, (HEIGHT, WIDTH, 3))
    assert not any(told([measured(0), dark, dark, measured(3)]))
    assert not any(told([np.full((3, 4, 4), grey, np.uint8) for grey in (10, 50)]))


def test_without_contrast_an_offset_is_another_exposure() -> None:
    first = np.full(50, 100.0)
    law = law_of_grey(CONFIG, np.full(50, 30.0), first)
    assert law.offset == 0.0
    assert law.gain == pytest.approx(1.3)
