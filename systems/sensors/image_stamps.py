"""The stamps that a camera's driver puts on its images."""

from collections.abc import Callable

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPort, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.systems.port_values import StampedImage
from crossmodal.systems.port_values.streams import copied


class ImageStamps(LeafSystem):
    """Stamps images with the instant at which they are read: read them at the ticks.

    Input ports:
    - `color_image`: `ImageRgba8U`.
    - `depth_image`: `ImageDepth32F`, [m].

    Output ports:
    - `color_measured`, `depth_measured`: `StampedImage` of them.
    """

    def __init__(self) -> None:
        super().__init__()
        for name, kind in (("color", ImageRgba8U), ("depth", ImageDepth32F)):
            image = self.DeclareAbstractInputPort(f"{name}_image", Value(kind()))
            self.DeclareAbstractOutputPort(
                f"{name}_measured",
                lambda kind=kind: AbstractValue.Make(StampedImage(time=0.0, image=kind())),
                self._stamp(image),
                {self.input_port_ticket(image.get_index()), self.time_ticket()},
            )

    @staticmethod
    def _stamp(port: InputPort) -> Callable[[Context, AbstractValue], None]:
        def stamp(context: Context, output: AbstractValue) -> None:
            image = copied(port.Eval(context))
            output.set_value(StampedImage(time=context.get_time(), image=image))

        return stamp
