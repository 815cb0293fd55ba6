"""The images of a camera that is knocked out of its place."""

import bisect
from collections.abc import Callable, Sequence
from typing import Any

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPort, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

IMAGES = {"color_image": ImageRgba8U, "depth_image_32f": ImageDepth32F}  # As `RgbdSensor` says.


class BumpedCamera(LeafSystem):
    """Hands out the images of the place at which the camera stands by now.

    Each place is an `RgbdSensor` of its own; only the one that is asked for renders.

    Input ports:
    - `color_image_K`: `ImageRgba8U` from the place after K bumps, K = 0 before any.
    - `depth_image_32f_K`: `ImageDepth32F` likewise, [m].

    Output ports:
    - `color_image`, `depth_image_32f`: those of the place at which the camera is.

    Args:
        starts: When each bump happens, in order, [s].
    """

    def __init__(self, starts: Sequence[float]) -> None:
        super().__init__()
        self._starts = list(starts)
        for name, kind in IMAGES.items():
            inputs = [
                self.DeclareAbstractInputPort(f"{name}_{index}", Value(kind()))
                for index in range(len(self._starts) + 1)
            ]
            tickets = {self.time_ticket(), *(port.ticket() for port in inputs)}
            self.DeclareAbstractOutputPort(name, Value(kind()).Clone, self._pass(inputs), tickets)

    def _pass(self, inputs: Sequence[InputPort]) -> Callable[[Context, AbstractValue], None]:
        def hand_out(context: Context, output: AbstractValue) -> None:
            image: Any = inputs[bisect.bisect_right(self._starts, context.get_time())]
            output.set_value(image.Eval(context))

        return hand_out
