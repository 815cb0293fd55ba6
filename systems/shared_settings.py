"""What all filters of a network share, and how it gets into their configurations.

A configuration names what is shared by an attribute that is no field, such as `period` or `noise`:
no scenario can give two filters two values of it. The factory of the network hands over the values.
"""

import copy
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number

C = TypeVar("C")


@dataclass(kw_only=True)
class SensorNoise:
    """How noisy the robot believes a sample of its sensors to be, as standard deviations.

    What a simulated sensor draws is declared by that sensor. The noise of a pixel's depth z is
    depth + depth_growth (z - depth_range)^2.

    Attributes:
        angle: Of an encoder.
        rate: Of an encoder's velocity.
        offset_rotation: By how much the encoders' constant offsets turn the end-effector.
        offset_translation: By how much they shift it.
        torque: Of the wrist's sensor.
        force: Of the wrist's sensor.
        pressure: Of a chamber of the hand.
        taxel: Of a fingertip's taxel.
        depth: Of a pixel at `depth_range`.
        depth_growth: With the square of the distance from there.
        depth_range: Distance of the least noise.
    """

    angle: float = number(1e-4, at_least=1e-9, at_most=1.0, unit="rad")
    rate: float = number(5e-3, at_least=1e-9, at_most=100.0, unit="rad/s")
    offset_rotation: float = number(float(np.deg2rad(3.0)), at_least=0.0, at_most=3.2, unit="rad")
    offset_translation: float = number(0.01, at_least=0.0, at_most=10.0, unit="m")
    torque: float = number(0.005, at_least=1e-9, at_most=1000.0, unit="N m")
    force: float = number(0.1, at_least=1e-9, at_most=1e4, unit="N")
    pressure: float = number(100.0, at_least=1e-6, at_most=1e6, unit="Pa")
    taxel: float = number(0.01, at_least=1e-6, at_most=10.0, unit="N")
    depth: float = number(1.2e-3, at_least=0.0, at_most=1.0, unit="m")
    depth_growth: float = number(1.9e-3, at_least=0.0, at_most=1.0, unit="1/m")
    depth_range: float = number(0.4, at_least=0.0, at_most=100.0, unit="m")

    @property
    def wrench(self) -> Array:
        """Of a sample (6,) of the wrist's sensor, torque [N m] then force [N]."""
        return np.repeat([self.torque, self.force], 3)


def with_shared(config: C, **shared: Any) -> C:
    """A copy of a dataclass in which it and all its parts have the values that are shared.

    Args:
        config: A dataclass, with others among its fields.
        shared: Values by the name of the attribute that stands for them; who has a field of this
            name, or no such attribute, is left as it is.
    """
    copied, own = copy.copy(config), [item.name for item in fields(config)]  # type: ignore[arg-type]
    for name in own:
        part = getattr(config, name)
        if is_dataclass(part):
            setattr(copied, name, with_shared(part, **shared))
    for name, value in shared.items():
        if name not in own and hasattr(config, name):
            setattr(copied, name, value)
    return copied
