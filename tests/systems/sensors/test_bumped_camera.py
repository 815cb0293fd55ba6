"""The images of a camera that is knocked: those of where it stands by then."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.systems.sensors.bumped_camera import BumpedCamera


@pytest.mark.parametrize(("time", "place"), [(0.0, 0), (0.99, 0), (1.0, 1), (1.5, 1), (2.0, 2)])
def test_each_bump_counts_from_its_instant_on(time: float, place: int) -> None:
    system = BumpedCamera([1.0, 2.0])
    context = system.CreateDefaultContext()
    for index in range(3):
        color, depth = ImageRgba8U(2, 1, index), ImageDepth32F(2, 1, 1.0 + index)
        for name, image in (("color_image", color), ("depth_image_32f", depth)):
            port = system.GetInputPort(f"{name}_{index}")
            port.FixValue(context, AbstractValue.Make(image))
    context.SetTime(time)
    assert np.all(system.GetOutputPort("color_image").Eval(context).data == place)
    assert np.all(system.GetOutputPort("depth_image_32f").Eval(context).data == 1.0 + place)
