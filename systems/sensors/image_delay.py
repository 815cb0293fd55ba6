"""Images that arrive later than they are taken."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State

from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values.streams import copied


@dataclass(frozen=True)
class _Taken(Immutable):
    """Images that are under way, the oldest first."""

    images: tuple[Any, ...] = ()


class ImageDelay(LeafSystem):
    """Delivers at each tick the image that was taken a latency before it.

    Images are taken at the instants k period - latency, so that each is rendered once. The first
    one is taken at the start, and is delivered until others have had the time to arrive.

    Input ports:
    - `image`: an image of Drake's, as the model.

    Output ports:
    - `image_delayed`: the same one, late.

    State: the images under way; it is shared, not copied, since nobody writes them.

    Args:
        model: Of the image.
        latency: Between taking and delivering an image, [s].
        period: Of the ticks, [s].
    """

    def __init__(self, model: AbstractValue, latency: float, period: float) -> None:
        super().__init__()
        if not 0.0 < latency < np.inf:
            raise ValueError(f"ImageDelay: need latency > 0 s, got {latency!r}")
        if not 0.0 < period < np.inf:
            raise ValueError(f"ImageDelay: need period > 0 s, got {period!r}")
        self._under_way = 1 + int(latency / period)
        self._image = self.DeclareAbstractInputPort("image", model)
        state = self.DeclareAbstractState(Value[object](_Taken()))
        self.DeclareAbstractOutputPort(
            "image_delayed", model.Clone, self._deliver, {self.abstract_state_ticket(state)}
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._take)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, -latency % period, self._take)

    def _take(self, context: Context, state: State) -> None:
        taken: _Taken = context.get_abstract_state(0).get_value()
        images = (*taken.images, copied(self._image.Eval(context)))[-self._under_way :]
        state.get_mutable_abstract_state(0).set_value(_Taken(images))

    def _deliver(self, context: Context, output: AbstractValue) -> None:
        output.set_value(context.get_abstract_state(0).get_value().images[0])
