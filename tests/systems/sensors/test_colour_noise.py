import numpy as np
import pytest

from crossmodal.maths.validation import check
from crossmodal.systems.sensors.colour_noise import (
    ColourNoiseConfig,
    mean_grey,
    measure_colour,
    next_gain,
    noisy_response,
    response,
)
from crossmodal.systems.sensors.randomness import random_bytes

CONFIG = ColourNoiseConfig()


def measured_patch(grey, light=1.0, gain=1.0, seed=0, size=200):
    ideal = np.full((size, size, 4), grey, dtype=np.uint8)
    measured = np.zeros_like(ideal)
    random = random_bytes(np.random.default_rng(seed), 3 * size * size)
    measure_colour(ideal, noisy_response(CONFIG, light, gain), random, measured)
    return measured


def linear(grey):
    return (np.asarray(grey, dtype=np.float64) / 255.0) ** CONFIG.gamma


def test_normal_light_and_gain_leave_the_mean_as_it_is():
    np.testing.assert_allclose(response(CONFIG, 1.0, 1.0), np.arange(256), atol=1.5)


@pytest.mark.parametrize(("grey", "light"), [(60, 1.0), (120, 1.0), (180, 1.0), (180, 0.3)])
def test_noise_is_that_of_the_collected_electrons(grey, light):
    measured = linear(measured_patch(grey, light)[:, :, :3])
    electrons = CONFIG.full_well * light * linear(grey)
    sigma = np.sqrt(electrons + CONFIG.read_noise**2) / CONFIG.full_well
    np.testing.assert_allclose(measured.mean(), light * linear(grey), rtol=0.02)
    np.testing.assert_allclose(measured.std(), sigma, rtol=0.05)


def test_amplified_darkness_is_noisier_than_light_of_the_same_mean():
    light = measured_patch(120, light=1.0, gain=1.0)[:, :, :3]
    dark = measured_patch(120, light=0.25, gain=4.0)[:, :, :3]
    np.testing.assert_allclose(dark.mean(), light.mean(), atol=1.5)
    assert dark.std() > 1.8 * light.std()


def test_no_light_is_black_and_too_much_is_white():
    assert measured_patch(200, light=0.0)[:, :, :3].mean() < 15.0
    assert (measured_patch(200, light=8.0)[:, :, :3] == 255).all()


def test_pixels_and_channels_are_independent():
    noise = measured_patch(120)[:, :, :3].astype(np.float64) - 120.0
    variance = noise.var()
    assert abs(np.mean(noise[:, 1:] * noise[:, :-1])) < 0.03 * variance
    assert abs(np.mean(noise[:, :, 0] * noise[:, :, 1])) < 0.03 * variance


def test_alpha_is_opaque():
    assert (measured_patch(120)[:, :, 3] == 255).all()


def test_mean_grey_is_that_of_the_measured_image():
    rng = np.random.default_rng(3)
    ideal = rng.integers(0, 256, (480, 640, 4)).astype(np.uint8)
    table = response(CONFIG, 0.6, 1.3)
    measured = np.zeros_like(ideal)
    random = random_bytes(rng, 3 * 480 * 640)
    measure_colour(ideal, noisy_response(CONFIG, 0.6, 1.3), random, measured)
    np.testing.assert_allclose(mean_grey(ideal, table), measured[:, :, :3].mean(), atol=1.0)


def test_gain_settles_where_the_mean_grey_is_sought():
    gain, patch = 1.0, np.full((8, 8, 4), 120, dtype=np.uint8)
    for _ in range(60):
        grey = mean_grey(patch, response(CONFIG, 0.3, gain))
        gain = next_gain(CONFIG, gain, grey, 120.0, 1.0 / 15.0)
    np.testing.assert_allclose(gain, 1.0 / 0.3, rtol=0.05)


def test_gain_lags_by_the_time_constant():
    grey = 255.0 * 0.5 ** (1.0 / CONFIG.gamma)
    gain = next_gain(CONFIG, 1.0, grey, 255.0, CONFIG.exposure_time_constant)
    np.testing.assert_allclose(np.log(gain) / np.log(2.0), 1.0 - np.exp(-1.0), rtol=1e-6)


def test_gain_keeps_its_limits():
    assert next_gain(CONFIG, 7.9, 0.0, 128.0, 10.0) == CONFIG.gain_max
    assert next_gain(CONFIG, 0.11, 255.0, 1.0, 10.0) == CONFIG.gain_min


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("full_well", 0.0),
        ("read_noise", -1.0),
        ("gamma", float("nan")),
        ("exposure_time_constant", 0.0),
        ("gain_min", 2.0),
        ("gain_max", 0.5),
        ("grey_target", 300.0),
    ],
)
def test_impossible_values_are_refused_by_name(field, value):
    config = ColourNoiseConfig(**{field: value})
    with pytest.raises(ValueError, match=f"ColourNoiseConfig: {field}"):
        check(config, "ColourNoiseConfig")
