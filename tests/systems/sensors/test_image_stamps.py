"""Images get the instant of their tick as a stamp, and stay as they were."""

import numpy as np
from numpy.testing import assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.systems.sensors.image_stamps import ImageStamps


def test_an_image_is_stamped_with_the_tick_and_keeps_its_pixels_for_good() -> None:
    system = ImageStamps()
    context = system.CreateDefaultContext()
    color, depth = ImageRgba8U(3, 2, 7), ImageDepth32F(3, 2, 1.5)
    fixed = [
        system.GetInputPort(f"{name}_image").FixValue(context, AbstractValue.Make(image))
        for name, image in (("color", color), ("depth", depth))
    ]
    context.SetTime(0.4)
    stamped = [
        system.GetOutputPort(f"{name}_measured").Eval(context) for name in ("color", "depth")
    ]
    fixed[1].GetMutableData().get_mutable_value().mutable_data[:] = 2.5
    assert [image.time for image in stamped] == [0.4, 0.4]
    assert_array_equal(stamped[0].image.data, color.data)
    assert np.all(stamped[1].image.data == 1.5)
