"""Images that arrive later than they are taken."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values.images import copied


@dataclass(frozen=True)
class _Taken(Immutable):
    """Pairs of colour and depth image that are under way, the oldest first."""

    frames: tuple[tuple[Any, Any], ...] = ()


class ImageDelay(LeafSystem):
    """Delivers at each tick the images that were taken a latency before it.

    Images are taken at the instants k period - latency, so that each is rendered once. The first
    one is taken at the start, and is delivered until others have had the time to arrive.

    .. pydrake_system::

        name: ImageDelay
        input_ports:
        - color_image
        - depth_image
        output_ports:
        - color_measured
        - depth_measured

    - `color_image`, `color_measured`: `ImageRgba8U`.
    - `depth_image`, `depth_measured`: `ImageDepth32F`, [m].

    State: the images under way; it is shared, not copied, since nobody writes them.

    Args:
        latency: Between taking and delivering an image, [s].
        period: Of the ticks, [s].
    """

    def __init__(self, latency: float, period: float) -> None:
        super().__init__()
        if not 0.0 < latency < np.inf:
            raise ValueError(f"ImageDelay: need latency > 0 s, got {latency!r}")
        if not 0.0 < period < np.inf:
            raise ValueError(f"ImageDelay: need period > 0 s, got {period!r}")
        self._under_way = 1 + int(latency / period)
        self._color = self.DeclareAbstractInputPort("color_image", Value(ImageRgba8U()))
        self._depth = self.DeclareAbstractInputPort("depth_image", Value(ImageDepth32F()))
        state = self.DeclareAbstractState(Value[object](_Taken()))
        on_state = {self.abstract_state_ticket(state)}
        for index, (name, kind) in enumerate((("color", ImageRgba8U), ("depth", ImageDepth32F))):
            self.DeclareAbstractOutputPort(
                f"{name}_measured", lambda kind=kind: Value(kind()), self._deliver(index), on_state
            )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._take)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, -latency % period, self._take)

    def _take(self, context: Context, state: State) -> None:
        taken: _Taken = context.get_abstract_state(0).get_value()
        color = copied(self._color.Eval(context))
        depth = copied(self._depth.Eval(context))
        frames = (*taken.frames, (color, depth))[-self._under_way :]
        state.get_mutable_abstract_state(0).set_value(_Taken(frames))

    def _deliver(self, index: int) -> Callable[[Context, AbstractValue], None]:
        def deliver(context: Context, output: AbstractValue) -> None:
            output.set_value(context.get_abstract_state(0).get_value().frames[0][index])

        return deliver
