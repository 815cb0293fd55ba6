import numpy as np

from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator, random_bytes


def test_white_noise_is_a_function_of_seed_name_and_index():
    noise, again = WhiteNoise(3, "a", 2), WhiteNoise(3, "a", 2)
    forward = np.array([noise(index) for index in range(0, 5000, 7)])
    backward = np.array([again(index) for index in reversed(range(0, 5000, 7))])[::-1]
    np.testing.assert_array_equal(forward, backward)
    for other in (WhiteNoise(4, "a", 2), WhiteNoise(3, "b", 2)):
        assert not np.any(forward[0] == other(0))


def test_white_noise_is_standard_normal_and_white():
    noise = WhiteNoise(0, "a", 3)
    samples = np.array([noise(index) for index in range(20000)])
    np.testing.assert_allclose(samples.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(samples.T), np.eye(3), atol=0.03)
    for lag in (1, 1024):
        assert np.abs(np.mean(samples[lag:] * samples[:-lag], axis=0)).max() < 0.03


def test_sensors_that_share_a_seed_do_not_share_their_noise():
    first, second = (make_generator(0, name).standard_normal(5000) for name in ("a", "b"))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


def test_bytes_are_uniform_and_as_many_as_asked_for():
    values = random_bytes(make_generator(0, "bytes"), 100003)
    assert values.shape == (100003,)
    counts = np.bincount(values, minlength=256)
    chi_square = np.sum((counts - counts.mean()) ** 2) / counts.mean()
    assert 180.0 < chi_square < 345.0  # 99.99 % of 255 degrees of freedom.
