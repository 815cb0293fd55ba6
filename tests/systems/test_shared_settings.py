"""What filters share reaches all of them, and no scenario can choose it for one alone."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.testing import assert_array_equal

from crossmodal.systems.shared_settings import SensorNoise, with_shared


@dataclass(kw_only=True)
class Part:
    noise = SensorNoise()
    gain: float = 2.0


@dataclass(kw_only=True)
class Whole:
    part: Part = field(default_factory=Part)
    noise: float = 0.1  # A field of its own.


def test_shared_values_reach_the_parts_that_name_them_and_no_field() -> None:
    noise, whole = SensorNoise(angle=0.5), Whole(part=Part(gain=3.0))
    shared = with_shared(whole, noise=noise, period=1.0)
    assert shared.part.noise is noise
    assert (shared.part.gain, shared.noise) == (3.0, 0.1)
    assert not hasattr(shared.part, "period")
    assert whole.part.noise.angle == 1e-4
    assert [item.name for item in fields(Part)] == ["gain"]


def test_the_wrists_noise_is_torque_then_force() -> None:
    assert_array_equal(SensorNoise(torque=1.0, force=2.0).wrench, np.repeat([1.0, 2.0], 3))
