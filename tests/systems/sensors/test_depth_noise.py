import numpy as np
import pytest

from crossmodal.systems.sensors.depth_noise import (
    DepthNoiseConfig,
    check_depth_noise,
    correlated_noise,
    depth_sigma,
    measure_depth,
    returns,
)

WIDTH, HEIGHT = 320, 240
FX, FY, CX, CY = 577.0, 577.0, 159.5, 119.5
BASELINE = 0.075
STEP = DepthNoiseConfig().depth_step
SIGMA = (1.2e-3, 1.9e-3)
GRAZING = np.deg2rad(80.0)


def returning(depth):
    return returns(depth, (FX, FY, CX, CY), (0.4, 3.5), BASELINE, float(np.cos(GRAZING)))


def flat(z):
    return np.full((HEIGHT, WIDTH), z, dtype=np.float32)


def measured_flat(z, seed=0):
    depth = flat(z)
    noise = correlated_noise(np.random.default_rng(seed), depth.shape, 9)
    everywhere = np.ones(depth.shape, dtype=np.bool_)
    return measure_depth(depth, everywhere, noise, STEP, *SIGMA)


def slanted(angle):
    """Depth of a plane 1 m away on the optical axis, turned by `angle` about the image's y."""
    u = np.arange(WIDTH)
    z = 1.0 / (1.0 - (u - CX) / FX * np.tan(angle))
    return np.tile(z.astype(np.float32), (HEIGHT, 1))


@pytest.mark.parametrize("z", [0.5, 0.8, 1.0, 1.5, 2.0, 3.0])
def test_depth_has_the_stated_mean_and_deviation_quantisation_included(z):
    measured = np.concatenate([measured_flat(z, seed).ravel() for seed in range(8)])
    sigma = depth_sigma(np.array(z), *SIGMA)
    np.testing.assert_allclose(measured.std(), sigma, rtol=0.1)
    np.testing.assert_allclose(measured.mean(), z, atol=0.15 * sigma)


@pytest.mark.parametrize("z", [0.8, 1.0, 2.0])
def test_depth_comes_in_steps_of_an_eighth_of_a_pixel_of_disparity(z):
    measured = measured_flat(z).astype(np.float64)
    disparity = 580.0 * 0.075 / measured
    np.testing.assert_allclose(8.0 * disparity, np.round(8.0 * disparity), atol=1e-3)
    steps = np.diff(np.unique(measured))
    np.testing.assert_allclose(np.median(steps), 2.87e-3 * z**2, rtol=0.03)


def test_noise_is_standard_normal():
    noise = correlated_noise(np.random.default_rng(0), (960, 1280), 9)
    np.testing.assert_allclose(noise.mean(), 0.0, atol=0.03)
    np.testing.assert_allclose(noise.std(), 1.0, rtol=0.03)
    np.testing.assert_allclose(np.mean(np.abs(noise) > 1.96), 0.05, atol=0.006)


@pytest.mark.parametrize("shift", [0, 3, 6, 9, 15])
def test_noise_correlation_falls_linearly_to_zero_at_the_window(shift):
    noise = correlated_noise(np.random.default_rng(1), (960, 1280), 9).astype(np.float64)
    for other in (noise[:, shift:], noise[shift:, :]):
        rows, columns = other.shape
        correlation = np.mean(noise[:rows, :columns] * other)
        np.testing.assert_allclose(correlation, max(0.0, 1.0 - shift / 9.0), atol=0.04)


@pytest.mark.parametrize("z", [0.0, 0.39, 3.6, np.inf])
def test_nothing_returns_from_outside_the_range(z):
    assert not returning(flat(z)).any()


def test_everything_returns_from_a_facing_wall_but_the_images_border():
    valid = returning(flat(1.0))
    assert valid[1:-1, 1:-1].all()
    assert not valid[0].any()
    assert not valid[:, -1].any()


@pytest.mark.parametrize(("degrees", "seen"), [(0, True), (60, True), (-60, True), (88, False)])
def test_a_grazing_surface_does_not_return(degrees, seen):
    depth = slanted(np.deg2rad(degrees))
    middle = slice(140, 180)  # The ray is within 2 deg of the optical axis there.
    assert returning(depth)[1:-1, middle].all() == seen
    assert returning(depth)[1:-1, middle].any() == seen


def test_a_surface_turned_about_the_other_image_axis_grazes_too():
    depth = np.ascontiguousarray(slanted(np.deg2rad(85.0))[:, 40:280].T)
    padded = np.full((HEIGHT, WIDTH), np.inf, dtype=np.float32)
    padded[:, 40:280] = depth[:HEIGHT]
    assert not returning(padded)[115:125, 60:260].any()


def test_the_shadow_lies_left_of_a_near_object_and_is_as_wide_as_the_disparities_differ():
    near, far = 0.8, 1.3
    depth = flat(far)
    depth[60:180, 150:250] = near
    valid = returning(depth)
    width = FX * BASELINE * (1.0 / near - 1.0 / far)
    row = valid[120]
    shadow = np.flatnonzero(~row[1:-1]) + 1
    assert shadow.max() == 149
    assert abs(len(shadow) - width) <= 1.0
    assert row[150:-1].all()
    assert valid[30, 1:-1].all()


def test_the_slope_at_a_depth_edge_does_not_remove_the_flat_surfaces_beside_it():
    depth = flat(1.0)
    depth[:, :100] = 0.6
    valid = returning(depth)
    assert valid[1:-1, 100:-1].all()
    assert valid[1:-1, 40:100].all()


def test_pixels_without_return_read_zero():
    depth = flat(1.0)
    valid = np.zeros(depth.shape, dtype=np.bool_)
    valid[10:20, 10:20] = True
    measured = measure_depth(depth, valid, flat(0.0), STEP, *SIGMA)
    np.testing.assert_array_equal(measured > 0.0, valid)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("range_min", 0.0),
        ("range_max", 0.3),
        ("sigma_base", -1e-3),
        ("sigma_square", float("nan")),
        ("baseline", 0.0),
        ("depth_step", -0.1),
        ("correlation_window", 4),
        ("grazing_angle", 1.6),
    ],
)
def test_impossible_values_are_refused_by_name(field, value):
    config = DepthNoiseConfig(**{field: value})
    with pytest.raises(ValueError, match=f"DepthNoiseConfig: {field}"):
        check_depth_noise(config)
