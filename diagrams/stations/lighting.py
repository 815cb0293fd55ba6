"""What disturbs a camera: darkness, and things in front of it."""

from dataclasses import dataclass, field

from pydrake.systems.framework import BasicVector, Context, LeafSystem


@dataclass(kw_only=True)
class Light:
    """When the lights are off and when something covers the camera, as (start, end), [s].

    Attributes:
        lamp: Intensity of a lamp at the camera.
    """

    lights_off: list[tuple[float, float]] = field(default_factory=list)
    covered: list[tuple[float, float]] = field(default_factory=list)
    lamp: float = 0.0


class Lighting(LeafSystem):
    """Light and cover over time; the disturbances of a scenario.

    .. pydrake_system::

        name: Lighting
        output_ports:
        - illumination
        - cover

    - illumination: (1,) 1 normal, 0 lights off.
    - cover: (1,) 1 while something covers the camera.
    """

    def __init__(self, light: Light) -> None:
        super().__init__()

        def within(intervals: list[tuple[float, float]], time: float) -> float:
            return float(any(start <= time < end for start, end in intervals))

        def illumination(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, 1.0 - within(light.lights_off, context.get_time()))

        def cover(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, within(light.covered, context.get_time()))

        self.DeclareVectorOutputPort("illumination", 1, illumination, {self.time_ticket()})
        self.DeclareVectorOutputPort("cover", 1, cover, {self.time_ticket()})
