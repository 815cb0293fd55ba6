"""What a colour camera makes of an ideal image: exposure, shot and read noise, saturation."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from crossmodal.maths.compiled import hot
from crossmodal.maths.validation import number

Bytes = npt.NDArray[np.uint8]

_LEVELS = 256


@dataclass(kw_only=True)
class ColourNoiseConfig:
    # Electrons at white, normal light and gain 1.
    full_well: float = number(4000.0, at_least=1.0, at_most=1e9, unit="electrons")
    # Standard deviation.
    read_noise: float = number(8.0, at_least=0.0, at_most=1e6, unit="electrons")
    # Grey is (linear intensity)^(1 / gamma).
    gamma: float = number(2.2, at_least=0.1, at_most=10.0)
    # Lag of the auto-exposure.
    exposure_time_constant: float = number(0.2, at_least=1e-3, at_most=60.0, unit="s")
    # Shortest exposure, relative to the one for normal light.
    gain_min: float = number(0.1, at_least=1e-3, at_most=1.0)
    gain_max: float = number(8.0, at_least=1.0, at_most=1000.0)  # Largest amplification.
    # Mean grey that the auto-exposure seeks, 0: its first frame's.
    grey_target: float = number(0.0, at_least=0.0, at_most=255.0)


@cache
def _encoding(gamma: float) -> Bytes:
    """Grey level of each of 65536 linear intensities."""
    return np.round(255.0 * np.linspace(0.0, 1.0, 65536) ** (1.0 / gamma)).astype(np.uint8)


@cache
def _quantiles() -> npt.NDArray[np.float32]:
    """Standard normal values (256,) of equal probability and unit variance."""
    z = ndtri((np.arange(_LEVELS) + 0.5) / _LEVELS)
    return (z / z.std()).astype(np.float32)


def _electrons(config: ColourNoiseConfig, light: float, gain: float) -> npt.NDArray[np.float32]:
    grey = np.arange(_LEVELS, dtype=np.float32) / np.float32(255.0)
    return np.float32(config.full_well * light * min(gain, 1.0)) * grey ** np.float32(config.gamma)


def _encode(config: ColourNoiseConfig, electrons: npt.NDArray[np.float32], gain: float) -> Bytes:
    scale = np.float32(65535.0 * max(gain, 1.0) / config.full_well)
    linear = np.clip(electrons * scale, 0.0, 65535.0).astype(np.uint16)
    return _encoding(config.gamma)[linear]


def response(config: ColourNoiseConfig, light: float, gain: float) -> Bytes:
    """Noise-free measured grey (256,) of each ideal grey."""
    return _encode(config, _electrons(config, light, gain), gain)


def noisy_response(config: ColourNoiseConfig, light: float, gain: float) -> Bytes:
    """Measured grey (256, 256) of each ideal grey (row) and each equally likely noise (column).

    A pixel collects N electrons with variance N (shot) + read_noise^2. A gain below one shortens
    the exposure, one above it amplifies what was collected, noise included. Clipping at white and
    the gamma curve come last, as in the camera.

    Source: EMVA Standard 1288, linear camera model; the figures are typical of a small sensor.
    """
    mean = _electrons(config, light, gain)
    sigma = np.sqrt(mean + np.float32(config.read_noise**2))
    return _encode(config, mean[:, None] + sigma[:, None] * _quantiles()[None, :], gain)


@hot
def measure_colour(ideal: Bytes, table: Bytes, random: Bytes, measured: Bytes) -> None:
    """Writes `table[ideal, random]` to the colours of `measured` (h, w, 4); alpha is 255.

    Args:
        ideal: (h, w, 4).
        table: `noisy_response`.
        random: Uniform bytes (3 h w,).
        measured: (h, w, 4), written.
    """
    height, width, _ = ideal.shape
    i = 0
    for v in range(height):
        for u in range(width):
            for channel in range(3):
                measured[v, u, channel] = table[ideal[v, u, channel], random[i + channel]]
            measured[v, u, 3] = 255
            i += 3


def mean_grey(ideal: Bytes, table: Bytes) -> float:
    """Mean measured grey of an ideal image (h, w, 4), from every fourth pixel of every fourth row.

    Args:
        ideal: (h, w, 4).
        table: `response`.
    """
    return float(table[ideal[::4, ::4, :3]].mean())


def next_gain(
    config: ColourNoiseConfig, gain: float, grey: float, target: float, period: float
) -> float:
    """The auto-exposure's gain after one more frame of mean `grey`.

    A first-order lag in the logarithm of the gain, towards the gain that would bring the linear
    mean to the target's. Saturation hides how much too bright a frame is, so recovery from
    over-exposure is slower at first.
    """
    ratio = (max(target, 1.0) / max(grey, 1.0)) ** config.gamma
    share = 1.0 - np.exp(-period / config.exposure_time_constant)
    return float(np.clip(gain * ratio**share, config.gain_min, config.gain_max))
